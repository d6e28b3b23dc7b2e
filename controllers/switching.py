"""Switching: s/||s|| of (15) and its smooth versions: sigma(s) = eta(||s||) s/||s|| with a boundary layer (m/s).

Each function is two kernels and a row of `SWITCHING`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from kernels import choice, inline, kernel

SAMPLING_SHARE = 0.25  # of epsilon in (17) and of K_s s: kept for changes within a period, unknown to the law
APPROACH_SHARE = 0.5  # of epsilon: given up by a function that only approaches 1
STEPS, FOUND = 1000, 1e-12  # of the search for the layer's width, whose steps become smaller; of the layer


@dataclass(frozen=True)
class SwitchingFunction:
    """Switching function, a row of `SWITCHING`. Its eta is 1, or rises from 0 with the slope 1/layer, which only
    becomes smaller, to at most 1.

    kind: its name in a scenario; title: its name on the page.
    factor: inline kernel `(size, layer)`: eta(||s||) / ||s||, s/m, for ||s|| = size m/s > 0 and the layer m/s.
    width: inline kernel `(layer, given_up)`: norm ||s|| (m/s) from which on eta is 1 less the share that is given up.
    has_layer: whether it is smooth across s = 0.
    reaches_one: whether eta is 1 from the layer's edge on, whatever is given up.
    """

    kind: str
    title: str
    factor: Callable[..., Any]
    width: Callable[..., Any]
    has_layer: bool = True
    reaches_one: bool = False

    @property
    def reaching_share(self) -> float:
        """Share of epsilon left for reaching outside `layer_width`."""
        return 1.0 - SAMPLING_SHARE - (0.0 if self.reaches_one else APPROACH_SHARE)


@inline
def _discontinuous(size, _):
    return 1.0 / size


@inline
def _no_width(_layer, _given_up):
    return 0.0


@inline
def _saturation(size, layer):
    return 1.0 / max(size, layer)


@inline
def _saturation_width(layer, _):
    return layer


@inline
def _rational(size, layer):
    return 1.0 / (size + layer)


@inline
def _rational_width(layer, given_up):
    return layer * (1.0 - given_up) / given_up


@inline
def _tanh(size, layer):
    return np.tanh(size / layer) / size


@inline
def _tanh_width(layer, given_up):
    return layer * np.arctanh(1.0 - given_up)


SWITCHING: dict[str, SwitchingFunction] = {
    function.kind: function
    for function in (
        SwitchingFunction(
            "discontinuous", "s / ‖s‖ (discontinuous)", _discontinuous, _no_width, has_layer=False, reaches_one=True
        ),
        SwitchingFunction("saturation", "saturation", _saturation, _saturation_width, reaches_one=True),
        SwitchingFunction("rational", "s / (‖s‖ + s_b)", _rational, _rational_width),
        SwitchingFunction("tanh", "tanh", _tanh, _tanh_width),
    )
}
if TYPE_CHECKING:
    SwitchingName = str
else:
    SwitchingName = Literal[tuple(SWITCHING)]

_factor = choice([function.factor for function in SWITCHING.values()])
_width = choice([function.width for function in SWITCHING.values()])


def number_of(function: SwitchingFunction) -> int:
    """Number of a row of `SWITCHING` within kernels."""
    return list(SWITCHING.values()).index(function)


@kernel
def layer_width(number, layer, d, slope, epsilon):
    """Norm ||s|| (m/s) from which on d eta keeps its share of the margin epsilon in (17): outside of it, the proof
    holds. Infinite where there is none, since d grows too fast.
    number: of the switching function.
    d: N, for s = 0; slope: N s/m, by which it grows with ||s||."""
    if d <= 0.0:
        return 0.0
    width = 0.0
    for _ in range(STEPS):
        before = width
        # a d below half of epsilon keeps that share nowhere, and promises nothing
        width = _width(number, layer, min(APPROACH_SHARE * epsilon / (d + slope * before), 1.0))
        if width - before <= FOUND * layer:
            return width
    return np.inf


@kernel
def unit_factor(size, number, layer):
    """eta(||s||) / ||s||, s/m: sigma(s) is s times this, for ||s|| = size m/s; zero at s = 0.
    number: of the switching function."""
    if size == 0.0:
        return 0.0
    return _factor(number, size, layer)
