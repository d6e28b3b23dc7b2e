"""Changes of a scenario that take along what depends on them."""

import numpy as np
import pytest

from app.scenario.data import edited, shipped
from app.session.changes import in_mode, told
from app.simulation.system import assemble
from controllers import modes

pytestmark = pytest.mark.slow  # long or many simulations


@pytest.mark.parametrize("name", shipped())
@pytest.mark.parametrize("mode", modes.MODES)
def test_every_shipped_scenario_goes_into_every_mode(name: str, mode: str) -> None:
    changed = in_mode(shipped()[name], mode)
    assert changed.mode == mode
    assemble(changed)


def test_of_a_path_in_space_a_surface_keeps_what_lies_along_it_and_that_is_said() -> None:
    scenario = shipped()["ur5-impedance"]
    changed = in_mode(scenario, "hybrid")
    system = assemble(changed)
    # the wall is horizontal: what is kept is the horizontal part, whichever way its tangents point
    _, tangents = np.split(system.surface.chart(np.array([0.4, 0.1, 0.17]), 0.0).G, [1])
    moved = tangents.T @ np.array(changed.motion.displacement)
    np.testing.assert_allclose(moved, [*scenario.motion.displacement[:2], 0.0], atol=1e-6)
    assert "motion.displacement" in told(scenario, changed)
    assert str(list(scenario.motion.displacement)) in told(scenario, changed)
    assert told(scenario, in_mode(scenario, "motion")) == ""


def test_a_circle_that_leaves_the_surface_is_laid_on_it() -> None:
    upright = edited(shipped()["ur5-motion"], "motion", {"kind": "circle", "axes": [0, 2]})
    changed = in_mode(upright, "hybrid")
    assemble(changed)
    assert "motion.axes [0, 1] instead of [0, 2]" in told(upright, changed)
