"""The switching functions sigma(s) against their definitions, which are written again in `tests.support.arms`."""

from __future__ import annotations

import numpy as np
import pytest

from controllers.switching import SAMPLING_SHARE, Switching, layer_width, unit_factor
from tests.support.arms import ETA, unit_vector

LAYER = 0.02  # m/s


@pytest.mark.parametrize("kind", Switching)
def test_each_switching_function_is_its_definition(kind: Switching) -> None:
    """Within the layer, at its edge and outside of it, where the four differ; and nothing at s = 0."""
    towards = np.random.default_rng(1).standard_normal(4)
    for ratio in (0.0, 0.1, 1.0, 10.0):
        s = ratio * LAYER * towards / np.linalg.norm(towards)
        sigma = s * unit_factor(float(np.linalg.norm(s)), int(kind), LAYER)
        np.testing.assert_allclose(sigma, unit_vector(s, kind, LAYER), rtol=1e-12, atol=0.0)


@pytest.mark.parametrize("kind", Switching)
def test_layer_ends_where_the_switching_term_keeps_its_share_of_the_margin(kind: Switching) -> None:
    d, epsilon = 20.0, 2.0
    given_up = 0.5 * epsilon / d  # of d, by the functions that only approach 1
    widths = {
        Switching.DISCONTINUOUS: 0.0,
        Switching.SATURATION: LAYER,
        Switching.RATIONAL: LAYER * (1.0 - given_up) / given_up,
        Switching.TANH: LAYER * np.arctanh(1.0 - given_up),
    }
    width = layer_width(int(kind), LAYER, d, 0.0, epsilon)
    assert width == pytest.approx(widths[kind], rel=1e-12)
    lost = d * (1.0 - ETA[kind](width, LAYER))
    assert lost == pytest.approx((1.0 - SAMPLING_SHARE - kind.reaching_share) * epsilon, abs=1e-12)


@pytest.mark.parametrize("kind", Switching)
@pytest.mark.parametrize("slope", [0.5, 0.9])
def test_outside_of_the_layer_the_margin_is_kept_by_a_gain_that_grows_with_s(kind: Switching, slope: float) -> None:
    """The slope is the share of that with which the rational function would have no layer."""
    d, epsilon = 20.0, 2.0
    slope *= 0.5 * epsilon / LAYER
    width = layer_width(int(kind), LAYER, d, slope, epsilon)
    sizes = width + np.geomspace(1e-9, 1e3, 200)
    lost = [(d + slope * size) * (1.0 - ETA[kind](float(size), LAYER)) for size in sizes]
    assert max(lost) <= 0.5 * epsilon * (1.0 + 1e-6)
    if kind in (Switching.RATIONAL, Switching.TANH):
        at_edge = (d + slope * width) * (1.0 - ETA[kind](width, LAYER))
        assert at_edge == pytest.approx(0.5 * epsilon, rel=1e-6)
    assert np.isinf(layer_width(int(Switching.RATIONAL), LAYER, d, 0.5 * epsilon / LAYER, epsilon))


@pytest.mark.parametrize("kind", [Switching.RATIONAL, Switching.TANH])
def test_a_gain_below_half_of_the_margin_has_no_layer(kind: Switching) -> None:
    """Outside of which it would keep anything: the band is that of ||s|| = 0, a number."""
    assert layer_width(int(kind), LAYER, 0.5, 0.0, 2.0) == 0.0
