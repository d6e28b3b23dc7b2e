"""s/||s|| of (15) and its smooth versions: sigma(s) = eta(||s||) s/||s|| with a boundary layer phi (m/s)."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numba import njit


class Switching(IntEnum):
    """How the unit vector s/||s|| is smoothed around s = 0."""

    DISCONTINUOUS = 0  # eta = 1
    SATURATION = 1  # eta = min(1, ||s||/phi)
    RATIONAL = 2  # eta = ||s|| / (||s|| + phi)
    TANH = 3  # eta = tanh(||s||/phi)

    @property
    def kept(self) -> float:
        """Share of epsilon left for reaching outside `layer_width`; the versions that only approach 1 give up half."""
        return 1.0 if self in (Switching.DISCONTINUOUS, Switching.SATURATION) else 0.5


@njit(cache=True, error_model="numpy")
def layer_width(kind, phi, d, epsilon):
    """||s|| (m/s) from which on d eta keeps its share of the margin epsilon in (17): outside, the proof holds."""
    if kind == 0 or d <= 0.0:
        return 0.0
    if kind == 1:
        return phi
    given_up = 0.5 * epsilon / d
    if kind == 2:
        return phi * (1.0 - given_up) / given_up
    return phi * np.arctanh(1.0 - given_up)


@njit(cache=True, error_model="numpy")
def unit_vector(s, kind, phi):
    """sigma(s), (n,), for s (n,) m/s; zero at s = 0."""
    norm = np.sqrt(s @ s)
    if norm == 0.0:
        return np.zeros_like(s)
    if kind == 1:
        return s / max(norm, phi)
    if kind == 2:
        return s / (norm + phi)
    if kind == 3:
        return s * (np.tanh(norm / phi) / norm)
    return s / norm
