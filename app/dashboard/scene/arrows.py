"""Arrows of forces, to scale, and of the directions of the task coordinates at the tool."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import viser

from app.dashboard.theme.colors import SERIES, Rgb
from app.dashboard.transport.viser_private import draw_points, move
from app.dashboard.view_options import rounded_up
from environments.surfaces.corner import Corner
from environments.surfaces.table import Surface

UNIT = 0.1  # m: length of arrow to which the scale refers
LONGEST, SHORTEST = 0.22, 0.06  # m: a scale is kept while the longest arrow is between them
LEAST_SCALE = 1.0  # N per UNIT
LEAST_FORCE = 0.2  # N, or N m: below this no arrow
FRAME = 0.09  # m
Side = Literal[
    "bottom-left", "top-right", "top-left", "bottom-right"
]  # corner of the label that is at the arrow's tip, another one for each, so that labels do not overlap
_NEXT, _NEXT_BUT_ONE = [1, 2, 0], [2, 0, 1]  # of three axes


class ForceScale:
    """Scale of the arrows: N per `UNIT`, in round numbers that change only when arrows become too long or too short."""

    def __init__(self) -> None:
        self.newtons = 10.0

    def fit(self, forces: Sequence[np.ndarray], wanted: float | None) -> float:
        """Scale for forces (3,) N, in N per `UNIT`. wanted: the user's scale, returned as it is; None for none."""
        sizes = [float(np.linalg.norm(force)) for force in forces]
        largest = max((size for size in sizes if np.isfinite(size)), default=0.0)
        length = UNIT * largest / self.newtons
        if wanted is not None:
            self.newtons = wanted
        elif length > LONGEST or (length < SHORTEST and largest > LEAST_FORCE):
            self.newtons = rounded_up(largest * UNIT / LONGEST, LEAST_SCALE)
        return self.newtons


class ForceArrow:
    """Arrow of a force, to scale, with a label of its name and size; nothing in the scene hides it. A force near zero
    has no arrow."""

    def __init__(self, scene: viser.SceneApi, name: str, word: str, color: Rgb, side: Side, unit: str = "N") -> None:
        """Arrow without a force yet.
        name: of the scene node.
        word: what the label calls the force.
        side: corner of the label that is at the arrow's tip.
        unit: "N·m" for a moment, whose arrow is the axis about which it turns."""
        self._word, self._unit, self._text, self._visible = word, unit, "", False
        self._number = scene.add_label(f"{name}/number", "", visible=False, anchor=side)
        self._arrow = scene.add_arrows(
            name,
            np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 0.1]]]),
            color,
            shaft_radius=0.008,
            head_radius=0.02,
            head_length=0.04,
            visible=False,
        )

    def show(self, start: np.ndarray, force: np.ndarray, newtons: float) -> None:
        """Show the force (3,) from start (3,) m, `newtons` of its unit per `UNIT`."""
        size = math.sqrt(force @ force)
        visible = LEAST_FORCE < size < math.inf
        if visible:
            end = start + UNIT / newtons * force
            draw_points(self._arrow, np.array([[start, end]]))
            if (text := f"{self._word} {size:.1f} {self._unit}") != self._text:
                self._number.text = self._text = text
            move(self._number, end)
        if visible != self._visible:
            self._arrow.visible = self._number.visible = self._visible = visible


def task_directions(charted: Surface | Corner, p: np.ndarray, t: float) -> np.ndarray:
    """Directions of the task coordinates at the point p (3,) m, as unit rows (3, 3): the surfaces' normals, then for
    each other coordinate the direction in which p moves when it alone changes; the axes for Cartesian coordinates. Not
    finite where the coordinates are singular."""
    G, normals = charted.chart(p, t).G, charted.shapes.number
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = G[_NEXT], G[_NEXT_BUT_ONE]
        along = a[:, _NEXT] * b[:, _NEXT_BUT_ONE] - a[:, _NEXT_BUT_ONE] * b[:, _NEXT]  # columns of G^-1 times det G
        rows = np.concatenate([G[:normals], along[normals:] * np.sign(G[0] @ along[0])])
        return rows / np.sqrt((rows * rows).sum(axis=1, keepdims=True))


class TaskFrame:
    """Frame of the task coordinates' directions: thin arrows in the coordinates' colours of the plots."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._arrows = scene.add_arrows(
            name,
            np.stack([np.zeros((3, 3)), FRAME * np.eye(3)], axis=1),
            np.array(SERIES[:3]),
            shaft_radius=0.0025,
            head_radius=0.007,
            head_length=0.018,
            visible=False,
        )
        self._indices: Sequence[int] = (0, 1, 2)

    def show(self, charted: Surface | Corner, indices: Sequence[int], p: np.ndarray, t: float) -> None:
        """Show the first directions at the point p (3,) m. indices: numbers of the coordinates that are positions."""
        # repeats the last one, since the number of arrows is fixed
        drawn = np.minimum(np.arange(3), len(indices) - 1)
        if indices != self._indices:
            self._indices = indices
            self._arrows.colors = np.array([SERIES[i] for i in indices], dtype=np.uint8)[drawn]
        directions = task_directions(charted, p, t)[drawn]
        visible = bool(np.isfinite(directions).all())
        if visible:
            draw_points(self._arrows, np.stack([np.broadcast_to(p, (3, 3)), p + FRAME * directions], axis=1))
        self._arrows.visible = visible

    def hide(self) -> None:
        self._arrows.visible = False
