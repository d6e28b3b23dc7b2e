"""Ways out of refusals: what is offered, what it does, and how long it is offered."""

import numpy as np
import pytest

from app.scenario.data import differences, edited, shipped
from app.session.commands import (
    Command,
    DropWayOut,
    Edit,
    Fork,
    Pause,
    Pin,
    PushNow,
    Reset,
    Seek,
    ShowAgain,
    TakeWayOut,
    ToEnd,
)
from app.session.runner import Runner
from app.session.ways_out import nearest

pytestmark = pytest.mark.slow  # long or many simulations

SKEWED = (400.0 * np.eye(6) + 50.0 * np.eye(6, k=1)).tolist()


@pytest.mark.parametrize(
    ("scenario", "edits", "title", "path", "value"),
    [
        ("ur5-hybrid", {"surface.origin": [0.0, 0.0, -3.0]}, "Move the surface under the tool", None, None),
        ("ur5-hybrid", {"contact.B_e": 1e5}, "Take 13 steps per period", "contact.B_e", 1e5),
        ("ur5-hybrid", {"force.value": -20.0}, "Let the surface pull, too", "force.value", -20.0),
        ("ur5-corner", {"second.force.value": -5.0}, "Let the surface pull, too", "second.force.value", -5.0),
        ("ur5-hybrid", {"motion.radius": 2.0}, "Take a path that the arm can follow", None, None),
        ("ur5-hybrid", {"target_model.M_m": [0.0] * 6}, "Go 80 % of the way to it", None, None),
        ("ur5-hybrid", {"target_model.B_m": [-200.0, *[400.0] * 5]}, "Go 61 % of the way to it", None, None),
        ("ur5-motion", {"target_model.K_m": SKEWED}, "Take its symmetric part", None, None),
        ("ur5-hybrid", {"target_model.M_m": [float("nan")] * 6}, None, None, None),
        ("ur5-hybrid", {"controller.layer": -1.0}, None, None, None),
        ("ur5-hybrid", {"controller.nonsense": -1.0}, None, None, None),
        ("ur5-hybrid", {"simulation.substeps": 10**6}, "Take 1000, the largest allowed", "simulation.substeps", 1000),
    ],
)
def test_a_refusal_has_a_way_out_that_works(
    scenario: str, edits: dict[str, object], title: str | None, path: str | None, value: object
) -> None:
    runner = Runner(shipped()[scenario])
    before = runner._loop.system.scenario
    runner._obey([Edit(path, value) for path, value in edits.items()])
    refused = runner._publish()
    assert refused.refusal_number == 1
    assert (refused.way_out and refused.way_out.title) == title
    assert refused.scenario == before
    runner._obey([Pause(), TakeWayOut()])
    after = runner._publish()
    assert after.way_out is None
    if title is None:
        assert after.refusal == "way out: there is none; allowed: after a refusal that names one"
        return
    assert (after.refusal_number, after.phase) == (1, "paused")
    assert after.scenario != before
    if path is not None:  # what was asked for holds now
        assert differences(after.scenario, before)[path][0] == value
    for _ in range(50):
        runner._commanded.step()
    assert runner._loop.stopped is None


def test_a_bound_that_the_mode_refuses_is_no_way_out() -> None:
    runner = Runner(shipped()["ur5-hybrid"])
    runner._obey([Edit("contact.K_e", -3.0)])
    assert runner._publish().way_out is None
    runner = Runner(shipped()["ur5-impedance"])
    runner._obey([Edit("contact.K_e", -3.0), TakeWayOut()])
    assert runner._publish().scenario.contact.K_e == 0.0


@pytest.mark.parametrize(
    ("path", "typed", "bound"),
    [
        ("surface.tilt.amplitude", 1, 0.5),
        ("controller.period", 1, 0.05),
        ("simulation.substeps", 10**6, 1000),
        ("simulation.substeps", 1e6, 1000),
    ],
)
def test_a_bound_is_taken_as_it_is_also_where_a_whole_number_was_typed(path: str, typed: float, bound: float) -> None:
    scenario = shipped()["ur5-hybrid"]
    way = nearest(scenario, path, typed)
    assert way is not None
    assert way.scenario == edited(scenario, path, bound)
    assert way.title == f"Take {bound:g}, the largest allowed"


def refused_with_way_out(runner: Runner) -> None:
    """Have the runner refuse a layer, with a way out."""
    runner._obey([Edit("controller.layer", 100.0)])
    way = runner._publish().way_out
    assert way is not None
    assert way.title == "Take 10, the largest allowed"


def test_a_refusal_of_another_command_has_not_the_way_out_of_the_one_before() -> None:
    runner = Runner(shipped()["ur5-hybrid"])
    for _ in range(20):
        runner._commanded.step()
    runner._obey([Pause(), Pin()])
    refused_with_way_out(runner)
    runner._obey([Pin()])
    now = runner._publish()
    assert (now.refusal or "").startswith("pin: ")
    assert now.way_out is None


def test_a_way_out_brings_back_no_push_and_no_blend_that_are_over() -> None:
    pushed = Runner(shipped()["ur5-hybrid"])
    pushed._obey([PushNow()])
    refused_with_way_out(pushed)
    pushed._obey([Reset(), TakeWayOut()])
    assert pushed._publish().scenario == shipped()["ur5-hybrid"]

    blend = {"to": {"B_m": [200.0] * 6}, "at": 0.005, "over": 0.01}
    blending = Runner(edited(shipped()["ur5-impedance"], "blend", blend))
    refused_with_way_out(blending)
    while blending._loop.system.blend is not None:
        blending._commanded.step()
    t = blending._loop.t
    blending._obey([TakeWayOut()])
    assert blending._publish().way_out is None
    assert blending._loop.t == t


@pytest.mark.parametrize("look", [Seek(0.02), ToEnd(), ShowAgain(0.0, 0.05, 0.1)])
def test_a_way_out_takes_nothing_from_one_instant_to_another(look: Command) -> None:
    runner = Runner(shipped()["ur5-hybrid"])
    for _ in range(40):
        runner._commanded.step()
    runner._obey([Edit("controller.layer", 0.03)])
    for _ in range(20):
        runner._commanded.step()
    runner._obey([Seek(0.01)] if isinstance(look, ToEnd) else [])
    runner._obey([Edit("force.value", -20.0)])
    assert runner._publish().way_out is not None
    runner._obey([Seek(99.0)])  # refused: nothing else is looked at
    assert runner._publish().way_out is not None
    runner._obey([look, TakeWayOut()])
    now = runner._publish()
    assert (now.way_out, now.refusal) == (None, "way out: there is none; allowed: after a refusal that names one")
    assert now.scenario.controller.layer == (
        0.03 if isinstance(look, ToEnd) else shipped()["ur5-hybrid"].controller.layer
    )


def test_a_refusal_of_the_page_has_not_the_way_out_of_the_one_before() -> None:
    runner = Runner(shipped()["ur5-hybrid"])
    runner._obey([Edit("force.value", -20.0)])
    assert runner._publish().way_out
    runner._obey([DropWayOut()])
    assert runner._publish().way_out is None
    runner._obey([TakeWayOut()])
    assert runner._publish().scenario == shipped()["ur5-hybrid"]


def test_a_fork_at_the_end_of_a_run_has_a_way_out_to_the_last_change() -> None:
    runner = Runner(shipped()["ur5-hybrid"])

    def step(times: int) -> None:
        for _ in range(times):
            runner._commanded.step()

    runner._obey([Fork()])
    assert runner._publish().way_out is None  # nothing has been yet
    step(30)
    runner._obey([Fork()])
    begun = runner._publish().way_out
    assert begun
    assert begun.title == "Fork at the earliest instant, 0.00 s"
    runner._obey([Edit("force.value", 25.0)])
    step(30)
    runner._obey([Fork()])
    asked = runner._publish()
    assert asked.way_out
    assert asked.way_out.title == "Fork at the last change, 0.03 s"
    runner._obey([TakeWayOut()])
    forked = runner._publish()
    assert (forked.phase, forked.way_out, forked.looking_back) == ("paused", None, False)
    assert (forked.t, forked.scenario.force.value) == (pytest.approx(0.03), 25.0)
    assert forked.forks == (pytest.approx(0.03),)
    assert [pinned.t for pinned in forked.pinned] == [pytest.approx(0.06)]

    step(10)
    runner._obey([Fork(), Reset()])  # its instant is one of the run before
    assert runner._publish().way_out is None


def test_an_irregular_further_surface_has_a_way_out_of_its_own() -> None:
    """The first surface stays as it is."""
    runner = Runner(edited(shipped()["ur5-corner"], "surface.normal", [0.05, 0.0, -1.0]))
    runner._obey([Edit("second.surface", "formula"), Edit("second.surface.text", "0.9 - y")])
    refused = runner._publish()
    assert refused.refusal
    assert "second.surface.text" in refused.refusal
    assert refused.way_out
    runner._obey([TakeWayOut()])
    now = runner._publish()
    assert now.way_out is None
    assert now.scenario.surface == refused.scenario.surface
    assert now.scenario.second.surface.text != "0.9 - y"
