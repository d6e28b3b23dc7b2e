"""Stations: postures along the reference at which the sampled loops are judged, instead of at every posture between
them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.simulation.period.observation import Observer
from environments.surfaces.table import Surface

APART = 0.1  # rad, largest change of a joint from one station to the next
TURNED = 0.1  # rad, the same of a surface's normal at the tool
SAME_STATION = 0.02  # rad, largest change of a joint from a station where a curved surface has much the same normal


@dataclass(frozen=True)
class Stations:
    """Postures along the reference, `APART` from each other, or on curved surfaces with normals that differ by
    `TURNED`.
    q: (S, n) rad.
    t: (S,) s.
    of: (N,), number of the station that stands for each centre of Omega."""

    q: np.ndarray
    t: np.ndarray
    of: np.ndarray

    @classmethod
    def along(cls, centres: np.ndarray, instants: np.ndarray, normals: np.ndarray) -> Stations:
        """Stations among the centres (N, n) of Omega, at which the reference is at the instants (N,) s.
        normals: (N, S, 3), unit normals of S curved surfaces at the tool."""
        chosen, of = [0], np.zeros(len(centres), dtype=int)
        for k, q in enumerate(centres):
            joints = np.abs(centres[chosen] - q).max(axis=1) / APART
            turned = np.linalg.norm(normals[chosen] - normals[k], axis=2).max(axis=1, initial=0.0) / TURNED
            apart = np.maximum(joints, turned)
            if not apart.min() <= 1.0:
                chosen.append(k)
                of[k] = len(chosen) - 1
            else:
                of[k] = apart.argmin()
        return cls(centres[chosen], instants[chosen], of)


def turning_normals(
    surfaces: Sequence[Surface], observer: Observer, centres: np.ndarray, instants: np.ndarray
) -> np.ndarray:
    """Unit normals (N, S, 3) at the tool of those S surfaces whose normal is not fixed, at the centres (N, n) of Omega
    and their instants (N,) s."""
    curved = [each for each in surfaces if not each.form.normal_fixed]
    normals = np.zeros((len(centres), len(curved), 3))
    if curved:
        tools = observer.at_rest(centres, instants)["estimate"]["p"]
        for k, (p, t) in enumerate(zip(tools, instants, strict=True)):
            normals[k] = [each.chart(p, t).G[0] for each in curved]
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return normals
