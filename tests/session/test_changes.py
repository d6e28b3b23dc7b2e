"""Changes of a scenario that take along what depends on them."""

import random
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from app.scenario.data import edited, shipped
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.scenario.units import CARTESIAN, JOINT
from app.session.adaptation_sentence import adaptation_sentence
from app.session.changes import in_coordinates, in_mode, on_robot, on_surface, possible
from app.session.commands import (
    Command,
    DragTool,
    Edit,
    EditAll,
    PushNow,
    Seek,
    ShowAgain,
)
from app.session.runner import SILENCE, Runner
from app.session.snapshot import PREPARING
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from controllers.modes import MODES
from environments.catalogue import CATALOGUE
from environments.push import Grip
from environments.surfaces.table import SURFACES

pytestmark = pytest.mark.slow  # long or many simulations

# a surface of one's own needs a file
KINDS = [kind for form in SURFACES if (kind := str(form.__struct_config__.tag)) != "own"]
CHANGES: dict[str, tuple[Callable[[Scenario, str], Scenario], list[str]]] = {
    "mode": (in_mode, list(MODES)),
    "arm": (on_robot, list(CATALOGUE)),
    "surface": (on_surface, KINDS),
}


@pytest.mark.usefixtures("rough_constants")
@pytest.mark.parametrize("name", shipped())
@pytest.mark.parametrize("change", CHANGES)
def test_every_shipped_scenario_goes_into_modes_and_onto_arms_and_surfaces(name: str, change: str) -> None:
    """Every third of them for each scenario, another third for the next one: all pairs take a minute and a half."""
    changed, values = CHANGES[change]
    for value in values[list(shipped()).index(name) % 3 :: 3]:
        loop = possible(changed(shipped()[name], value), ClosedLoop.from_scenario)
        for _ in range(20):
            loop.step()
        assert loop.stopped is None, value


def _pairs() -> list[tuple[str, tuple[str, str], tuple[str, str]]]:
    """Pairs of two changes one after the other, on a shipped scenario: a sample, since there are thousands."""
    chance = random.Random(5)
    single = [(change, value) for change, (_, values) in CHANGES.items() for value in values]
    return [(chance.choice(list(shipped())), chance.choice(single), chance.choice(single)) for _ in range(40)]


@pytest.mark.usefixtures("rough_constants")
@pytest.mark.parametrize(("name", "first", "second"), _pairs())
def test_two_changes_one_after_the_other_are_possible(
    name: str, first: tuple[str, str], second: tuple[str, str]
) -> None:
    scenario = shipped()[name]
    for change, value in (first, second):
        loop = possible(CHANGES[change][0](scenario, value), ClosedLoop.from_scenario)
        scenario = loop.system.scenario
        loop.step()
        assert loop.stopped is None


def test_of_a_path_in_space_a_surface_keeps_what_lies_along_it_and_that_is_said() -> None:
    scenario = shipped()["ur5-impedance"]
    changed = in_mode(scenario, "hybrid")
    system = assemble(changed)
    # the wall is horizontal: what is kept is the horizontal part, whichever way its tangents point
    _, tangents = np.split(system.surface.chart(np.array([0.4, 0.1, 0.17]), 0.0).G, [1])
    moved = tangents.T @ np.array(changed.motion.displacement)
    np.testing.assert_allclose(moved, [*scenario.motion.displacement[:2], 0.0], atol=1e-6)
    assert (
        adaptation_sentence(scenario, changed, CARTESIAN)
        == "Adapted: path by 0.1, −0.05 instead of 0.1, 0.05, −0.03 m; target model back at the mode's defaults."
    )
    usual = edited(scenario, "target_model", {})
    assert adaptation_sentence(usual, in_mode(usual, "motion"), CARTESIAN) == ""


def test_what_another_arm_takes_from_the_gains_the_true_arm_and_further_surfaces_is_said() -> None:
    scenario = edited(shipped()["ur5-corner"], "controller.K_s", [100.0, 100.0, 100.0, 50.0, 50.0, 50.0])
    scenario = edited(scenario, "truth.link_scaling", [1.1, 1.0, 1.0, 1.0, 1.0, 1.0])
    done = possible(on_robot(scenario, "ur3"), ClosedLoop.from_scenario).system.scenario
    said = adaptation_sentence(edited(scenario, "robot.name", "ur3"), done, CARTESIAN)
    assert "K_s: one number for all coordinates" in said
    assert "converted" not in said
    assert "true arm: link scaling 1 instead of 1.1, 1, 1, 1, 1, 1" in said
    moved = edited(scenario, "second.surface.origin", [0.1, 0.2, 0.3])
    assert adaptation_sentence(scenario, moved, CARTESIAN) == "Adapted: second surface brought to the tool."


def test_a_circle_that_leaves_the_surface_is_laid_on_it() -> None:
    upright = edited(shipped()["ur5-motion"], "motion", {"kind": "circle", "axes": [0, 2]})
    changed = in_mode(upright, "hybrid")
    assemble(changed)
    assert "path plane first and second instead of first and third" in adaptation_sentence(upright, changed, CARTESIAN)
    assert "surface brought to the tool" in adaptation_sentence(upright, changed, CARTESIAN)


def test_of_a_path_in_space_a_planar_arm_keeps_what_lies_in_its_plane() -> None:
    scenario = shipped()["ur5-impedance"]
    x, _, z = scenario.motion.displacement
    assert on_robot(scenario, "planar3r").motion.displacement == (x, z)


@pytest.mark.parametrize("arm", [arm for arm in CATALOGUE if arm != "planar3r"])  # whose last link is too light for d
def test_joints_as_coordinates_keep_the_promise_with_gains_converted_by_the_characteristic_length(arm: str) -> None:
    scenario = shipped()["ur5-motion"]
    if arm != "ur5":
        scenario = possible(on_robot(scenario, arm), ClosedLoop.from_scenario).system.scenario
    asked = edited(scenario, "task_space.kind", "joint")
    loop = possible(in_coordinates(scenario, "kind", "joint"), ClosedLoop.from_scenario)
    done, l = loop.system.scenario, scenario.task_space.characteristic_length
    assert done.controller.layer == pytest.approx(scenario.controller.layer / l, rel=2e-3)
    assert done.controller.K_s == pytest.approx(scenario.controller.K_s * l**2, rel=2e-3)
    assert "boundary layer 0.0667 rad/s" in adaptation_sentence(asked, done, JOINT)
    CompiledRun(loop).advance(1500)
    assert loop.standing.now.verdict == "holds"
    assert np.abs(loop.recording.at(loop.t)["e_r"]).max() < 2e-4  # rad
    back = in_coordinates(done, "kind", "cartesian").controller
    assert back == scenario.controller
    assert in_mode(done, "impedance").controller == scenario.controller


def test_changes_within_a_section_of_a_section_are_said_too() -> None:
    scenario = shipped()["ur5-hybrid"]
    tilting = edited(scenario, "surface.tilt", {"amplitude": 0.1})
    assert adaptation_sentence(scenario, tilting, CARTESIAN) == "Adapted: surface tilts by 0.1 instead of 0 rad."


def test_a_path_that_is_too_long_for_an_arm_is_halved_until_it_can_be_followed() -> None:
    scenario = on_robot(shipped()["planar2r-semicircle"], "ur3")
    assert scenario.motion.displacement == shipped()["planar2r-semicircle"].motion.displacement
    done = possible(scenario, assemble).scenario
    assert done.motion.displacement == tuple(0.25 * value for value in scenario.motion.displacement)
    with pytest.raises(ScenarioError, match="cannot follow"):  # twice as long is too long
        assemble(edited(scenario, "motion.displacement", [2.0 * done.motion.displacement[0]]))


def test_a_gain_that_would_grow_without_bound_is_constant_and_that_is_said() -> None:
    scenario = on_robot(shipped()["planar2r-semicircle"], "z1")
    done = possible(scenario, ClosedLoop.from_scenario).system.scenario
    assert done.controller.gain == "constant" != scenario.controller.gain
    assert "gain d is constant now" in adaptation_sentence(scenario, done, CARTESIAN)


def test_what_no_adaptation_mends_is_refused() -> None:
    scenario = edited(shipped()["ur5-hybrid"], "surface.origin", [0.0, 0.0, 5.0])
    with pytest.raises(ScenarioError, match="out of the arm's reach"):
        possible(scenario, assemble)


@pytest.mark.parametrize("name", ["ur5-hybrid", "planar3r-hybrid"])
def test_a_push_by_the_button_is_felt_by_every_arm(name: str) -> None:
    runner = Runner(shipped()[name])
    alone = ClosedLoop.from_scenario(shipped()[name])
    runner._obey([PushNow()])
    for _ in range(100):
        runner._commanded.step()
        alone.step()
    asked, without = (loop.recording.at(loop.t)["tau"] for loop in (runner._loop, alone))
    assert np.abs(asked - without).max() > 1.0


def test_a_contact_of_a_further_surface_that_the_mode_cannot_have_is_another_one_and_that_is_said() -> None:
    runner = Runner(shipped()["ur5-hybrid"])
    runner._obey([Edit("second.contact.kind", "rigid")])
    asked = runner._publish()
    assert asked.scenario.second.contact.kind == "elastic"
    assert "second surface elastic instead of rigid" in asked.notice
    runner._obey([Edit("second.contact.kind", "nope")])
    refused = runner._publish()
    assert (refused.refusal or "").startswith("second.contact.kind: 'nope'; allowed: ")
    assert refused.scenario == asked.scenario


def test_a_change_that_no_file_could_hold_is_refused_and_nothing_is_lost() -> None:
    """A layer is converted to the units of joints; a push begins at the run's time."""
    runner = Runner(edited(shipped()["ur5-motion"], "controller.layer", 2.0))
    for command, sentence in (
        (Edit("task_space.kind", "joint"), "controller.layer: 13.3; allowed"),
        (PushNow(), "truth.push_start: 36010.0; allowed"),
    ):
        runner._loop.state.t = 36010.0 if isinstance(command, PushNow) else 0.0
        before = runner._loop.system.scenario
        runner._obey([command])
        assert sentence in (runner._publish().refusal or "")
        assert runner._loop.system.scenario == before


def test_a_time_that_is_refused_leaves_the_tool_in_the_hand() -> None:
    runner, hand = Runner(shipped()["ur5-hybrid"]), Grip((0.5, 0.0, 0.3))
    for _ in range(20):
        runner._commanded.step()
    runner._obey([DragTool(hand), Seek(float("nan")), ShowAgain(99.0, 100.0, 0.1)])
    assert runner._publish().refusal_number == 2
    assert runner._loop.grip == hand
    runner._obey([Seek(0.01)])
    assert runner._loop.grip is None


def test_a_valid_edit_before_a_refused_one_of_the_same_field_stays() -> None:
    runner = Runner(shipped()["ur5-hybrid"])
    runner._obey([Edit("controller.epsilon", value) for value in (2.5, 3.0, -1.0)])
    now = runner._publish()
    assert now.scenario.controller.epsilon == 3.0
    assert now.refusal
    assert "controller.epsilon: -1" in now.refusal


def test_a_long_drag_among_refused_values_tries_the_last_two_positions_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each can take longer than the slider needs to the next one; the loop must not fall behind more and more."""
    runner, tried = Runner(shipped()["ur5-hybrid"]), list[object]()
    execute = runner._commanded.execute

    def noted(command: Command) -> bool:
        tried.append(command)
        return execute(command)

    monkeypatch.setattr(runner._commanded, "execute", noted)
    dragged = [Edit("controller.epsilon", -float(k)) for k in range(1, 30)]
    runner._obey([*dragged])
    assert tried == [dragged[-1], dragged[-2]]


@pytest.mark.parametrize(
    ("command", "prepares"),
    [
        (Edit("contact.kind", "mass-damper-spring"), True),
        (Edit("third.contact.kind", "free"), True),
        (Edit("surface", "cylinder"), True),
        (Edit("face.flat", True), True),
        (Edit("motion", "line"), True),
        (Edit("motion.radius", 0.02), False),
        (EditAll({"force.value": 25.0, "second.surface.kind": "plane"}), True),
        (Edit("robot.name", "ur3"), True),
        (Edit("surface.motion.amplitude", 0.01), False),
        (Edit("contact.K_e", 3e4), False),
        (EditAll({"force.value": 25.0}), False),
    ],
)
def test_what_may_have_to_be_compiled_is_said_while_it_is(
    command: Command, prepares: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    runner, said = Runner(shipped()["ur5-hybrid"]), list[str]()

    def slow(_: Command) -> bool:
        monkeypatch.setattr(runner, "_came_round", runner._came_round - SILENCE - 1.0)
        said.append(runner.unrefreshed.notice)
        return True

    monkeypatch.setattr(runner._commanded, "execute", slow)
    monkeypatch.setattr(runner, "_thread", SimpleNamespace(is_alive=lambda: True))
    runner._obey([command])
    assert said == [PREPARING if prepares else ""]
    assert bool(runner.hang) != prepares
