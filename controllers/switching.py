"""Switching: s/||s|| of (15) and its smooth versions: sigma(s) = eta(||s||) s/||s|| with a boundary layer (m/s)."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from kernels import choice, inline, kernel

SAMPLING_SHARE = 0.25  # of epsilon in (17) and of K_s s: kept for changes within a period, unknown to the law
STEPS, FOUND = 1000, 1e-12  # of the search for the layer's width, whose steps become smaller; of the layer


class Switching(IntEnum):
    """Smoothing of the unit vector s/||s|| around s = 0."""

    DISCONTINUOUS = 0  # eta = 1
    SATURATION = 1  # eta = min(1, ||s||/layer)
    RATIONAL = 2  # eta = ||s|| / (||s|| + layer)
    TANH = 3  # eta = tanh(||s||/layer)

    @property
    def reaching_share(self) -> float:
        """Share of epsilon left for reaching outside `layer_width`: `SAMPLING_SHARE` is taken off, and half for the
        versions that only approach 1."""
        given_up = 0.0 if self in (Switching.DISCONTINUOUS, Switching.SATURATION) else 0.5
        return 1.0 - SAMPLING_SHARE - given_up


@inline
def _discontinuous(size, _):
    """eta(||s||) / ||s|| for ||s|| = size m/s > 0 and the layer m/s; all versions have these arguments."""
    return 1.0 / size


@inline
def _saturation(size, layer):
    return 1.0 / max(size, layer)


@inline
def _rational(size, layer):
    return 1.0 / (size + layer)


@inline
def _tanh(size, layer):
    return np.tanh(size / layer) / size


@inline
def _no_width(_layer, _given_up):
    """Norm ||s|| (m/s) from which on eta is 1 less the share of d that is given up; all versions have these
    arguments."""
    return 0.0


@inline
def _saturation_width(layer, _):
    return layer


@inline
def _rational_width(layer, given_up):
    return layer * (1.0 - given_up) / given_up


@inline
def _tanh_width(layer, given_up):
    return layer * np.arctanh(1.0 - given_up)


_factor = choice((_discontinuous, _saturation, _rational, _tanh))
_width = choice((_no_width, _saturation_width, _rational_width, _tanh_width))


@kernel
def layer_width(kind, layer, d, slope, epsilon):
    """Norm ||s|| (m/s) from which on d eta keeps its share of the margin epsilon in (17): outside of it, the proof
    holds. Infinite where there is none, since d grows too fast.
    d: N, for s = 0; slope: N s/m, by which it grows with ||s||."""
    if d <= 0.0:
        return 0.0
    width = 0.0
    for _ in range(STEPS):
        before = width
        # a d below half of epsilon keeps that share nowhere, and promises nothing
        width = _width(kind, layer, min(0.5 * epsilon / (d + slope * before), 1.0))
        if width - before <= FOUND * layer:
            return width
    return np.inf


@kernel
def unit_factor(size, kind, layer):
    """eta(||s||) / ||s||, s/m: sigma(s) is s times this, for ||s|| = size m/s; zero at s = 0."""
    if size == 0.0:
        return 0.0
    return _factor(kind, size, layer)
