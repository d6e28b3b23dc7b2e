"""The switching functions sigma(s): what each of the table must be, and those of the program against their definitions,
which are written again in `tests.support.arms`."""

from __future__ import annotations

import numpy as np
import pytest

from controllers.switching import APPROACH_SHARE, SAMPLING_SHARE, SWITCHING, layer_width, number_of, unit_factor
from tests.support.arms import ETA, unit_vector

LAYER = 0.02  # m/s


@pytest.mark.parametrize("kind", SWITCHING)
def test_each_switching_function_is_what_the_proof_takes_it_for(kind: str) -> None:
    """eta rises from 0 ever more slowly, with the slope 1/layer at first, and never beyond 1; where it has no layer it
    is 1. From its width on it is at least 1 less the share that is given up."""
    function = SWITCHING[kind]
    sizes = LAYER * np.geomspace(1e-9, 1e4, 500)
    eta = np.array([size * unit_factor(size, number_of(function), LAYER) for size in sizes])
    slopes = np.diff(eta) / np.diff(sizes)
    if function.has_layer:
        assert eta[0] == pytest.approx(sizes[0] / LAYER, rel=1e-6)
        rounding = 1e-15 / np.diff(sizes)
        assert (slopes >= -rounding).all()
        assert (np.diff(slopes) <= 1e-9 / LAYER + rounding[1:]).all()
        assert eta.max() <= 1.0 + 1e-15
        assert eta.max() == pytest.approx(1.0, abs=1e-3)
    else:
        np.testing.assert_allclose(eta, 1.0, rtol=1e-15)
    for given_up in (0.01, 0.1, 0.4):
        width = function.width.py_func(LAYER, given_up)
        outside = [size * unit_factor(size, number_of(function), LAYER) for size in width + sizes]
        assert min(outside) >= 1.0 - (1e-12 if function.reaches_one else given_up + 1e-9)


@pytest.mark.parametrize("kind", ETA)
def test_each_switching_function_is_its_definition(kind: str) -> None:
    """Within the layer, at its edge and outside of it, where the four differ; and nothing at s = 0."""
    function, towards = SWITCHING[kind], np.random.default_rng(1).standard_normal(4)
    for ratio in (0.0, 0.1, 1.0, 10.0):
        s = ratio * LAYER * towards / np.linalg.norm(towards)
        sigma = s * unit_factor(float(np.linalg.norm(s)), number_of(function), LAYER)
        np.testing.assert_allclose(sigma, unit_vector(s, function, LAYER), rtol=1e-12, atol=0.0)


@pytest.mark.parametrize("kind", ETA)
def test_layer_ends_where_the_switching_term_keeps_its_share_of_the_margin(kind: str) -> None:
    d, epsilon = 20.0, 2.0
    given_up = 0.5 * epsilon / d  # of d, by the functions that only approach 1
    widths = {
        "discontinuous": 0.0,
        "saturation": LAYER,
        "rational": LAYER * (1.0 - given_up) / given_up,
        "tanh": LAYER * np.arctanh(1.0 - given_up),
    }
    width = layer_width(number_of(SWITCHING[kind]), LAYER, d, 0.0, epsilon)
    assert width == pytest.approx(widths[kind], rel=1e-12)
    lost = d * (1.0 - ETA[kind](width, LAYER))
    assert lost == pytest.approx((1.0 - SAMPLING_SHARE - SWITCHING[kind].reaching_share) * epsilon, abs=1e-12)


@pytest.mark.parametrize("kind", SWITCHING)
@pytest.mark.parametrize("slope", [0.5, 0.9])
def test_outside_of_the_layer_the_margin_is_kept_by_a_gain_that_grows_with_s(kind: str, slope: float) -> None:
    """The slope is the share of that with which the rational function would have no layer."""
    function, d, epsilon = SWITCHING[kind], 20.0, 2.0
    slope *= 0.5 * epsilon / LAYER
    number = number_of(function)
    width = layer_width(number, LAYER, d, slope, epsilon)

    def lost_at(size: float) -> float:
        return (d + slope * size) * (1.0 - size * unit_factor(size, number, LAYER))

    assert max(lost_at(size) for size in width + np.geomspace(1e-9, 1e3, 200)) <= APPROACH_SHARE * epsilon * (
        1.0 + 1e-6
    )
    if not function.reaches_one:
        assert lost_at(width) == pytest.approx(APPROACH_SHARE * epsilon, rel=1e-6)
    rational = number_of(SWITCHING["rational"])
    assert np.isinf(layer_width(rational, LAYER, d, 0.5 * epsilon / LAYER, epsilon))


@pytest.mark.parametrize("kind", [kind for kind, function in SWITCHING.items() if not function.reaches_one])
def test_a_gain_below_half_of_the_margin_has_no_layer(kind: str) -> None:
    """Outside of which it would keep anything: the band is that of ||s|| = 0, a number."""
    assert layer_width(number_of(SWITCHING[kind]), LAYER, 0.5, 0.0, 2.0) == 0.0
