"""Events of a run: the ticks of its timeline."""

from __future__ import annotations

import numpy as np
import pytest

from app.analysis.run_events import Event, RunEvents
from app.scenario.data import edited, load
from app.scenario.schema import Scenario
from app.session.timeline import Timeline
from app.simulation.closed_loop import ClosedLoop
from app.simulation.recording import Epoch, Recording
from app.simulation.state import UNPROMISED
from controllers.target_model import TargetModel
from environments.push import Grip


def ran(line: Timeline, to: float) -> Timeline:
    while line.loop.t < to - 1e-9:
        line.step()
    return line


def events(line: Timeline, watch: RunEvents | None = None) -> list[tuple[float, str]]:
    state = line.loop.state
    found = (watch or RunEvents()).of(line.recording, line.end, state.flagged, line.forks)
    assert [event.t for event in found] == sorted(event.t for event in found)
    return [(round(event.t, 3), event.kind) for event in found]


@pytest.fixture
def pushed() -> Scenario:
    return edited(load("ur5-hybrid"), "truth", {"push": [0.0, 8.0, 0.0], "push_start": 0.1, "push_duration": 0.02})


def test_edits_pushes_and_forks_are_found_where_they_were(pushed: Scenario) -> None:
    line, watch = ran(Timeline(ClosedLoop.from_scenario(pushed)), 0.2), RunEvents()
    assert (0.1, "push") in events(line, watch)
    line.edit(edited(line.loop.system.scenario, "force.value", 25.0))
    ran(line, 0.3)
    line.drag_tool(Grip(line.loop.view().tool + np.array([0.0, 0.02, 0.0]), 500.0, 60.0))
    ran(line, 0.35)
    line.drag_tool(None)
    ran(line, 0.4)
    found = events(line, watch)  # read in pieces
    assert found == events(line)  # read at once
    done = [event for event in found if event[1] != "contact"]
    assert [kind for _, kind in done] == ["push", "edit", "push"]
    assert [t for t, _ in done] == pytest.approx([0.1, 0.2, 0.3], abs=2e-3)

    line.seek(0.25)
    line.fork()
    ran(line, 0.3)
    assert [event for event in events(line, watch) if event[1] != "contact"] == [
        (0.1, "push"), (0.2, "edit"), (0.25, "fork")
    ]  # fmt: skip
    line.reset()
    ran(line, 0.05)
    assert not [kind for _, kind in events(line, watch) if kind in ("edit", "fork", "push")]


def test_a_push_by_the_button_is_no_edit_and_an_edit_says_what(pushed: Scenario) -> None:
    line = ran(Timeline(ClosedLoop.from_scenario(pushed)), 0.15)
    line.edit(edited(pushed, "truth.push_start", 0.2))
    ran(line, 0.25)
    assert [kind for t, kind in events(line) if t > 0.1 - 1e-9] == ["push", "push"]
    line.edit(edited(line.loop.system.scenario, "controller.law", "computed-torque"))
    ran(line, 0.26)
    last = RunEvents().of(line.recording, line.end, None, ())[-1]
    changed = (("controller.law", "computed-torque"),)
    assert last == Event(last.t, "edit", "controller.law = computed-torque", changed)


def test_a_sine_begins_at_zero_and_is_told_by_its_amplitudes() -> None:
    truth = {"push": [6.0, 8.0, 0.0], "push_moment": [0.0, 0.0, 0.5], "push_start": 0.1, "push_frequency": 2.0}
    line = ran(Timeline(ClosedLoop.from_scenario(edited(load("ur5-hybrid"), "truth", truth))), 0.15)
    (push,) = (each for each in RunEvents().of(line.recording, line.end, None, ()) if each.kind == "push")
    assert push.what == "pushed with up to 10 N and 0.5 N·m"


@pytest.mark.parametrize("further", ["second", "third"])
def test_a_contact_is_told_of_each_surface_as_it_is_at_last(further: str) -> None:
    """Also where the scenario has a first and a third surface, which is the second one of the run."""
    scenario = edited(load("ur5-hybrid"), f"{further}.contact.kind", "elastic")
    recording = Recording(2, 4096)
    recording.epochs.append(Epoch(0.0, scenario, TargetModel(*np.ones((4, 1, 1))), UNPROMISED))
    for k in range(600):
        row = recording.new_row()
        row.view(float)[:] = 0.0
        t = 1e-3 * k
        row["t"], row["multiplier"] = t, float(0.1 <= t < 0.15)  # made, and lost for good within APART
        row["multiplier_2"] = float(t < 0.3 or t >= 0.32)  # lost for 20 ms
        recording.commit()
    found = RunEvents()
    events = [(round(event.t, 3), event.what) for event in found.of(recording, 0.6, None, ())]
    assert events == [(0.1, "contact made"), (0.15, "contact lost"), (0.3, f"contact lost, {further} surface"),
                    (0.32, f"contact made, {further} surface")]  # fmt: skip


def test_contact_and_a_run_that_leaves_the_domain() -> None:
    line = ran(Timeline(ClosedLoop.from_scenario(load("ur5-hybrid"))), 0.8)
    rows = line.recording.signals(("t", "phi", "F_true"))
    first = rows["t"][np.flatnonzero(np.linalg.norm(rows["F_true"], axis=1) > 0.0)[0]]
    assert first > 0.0
    assert events(line) == [(pytest.approx(first, abs=2e-3), "contact")]
    weak = edited(load("ur5-hybrid"), "truth.torque_limit", 0.1)
    line = Timeline(ClosedLoop.from_scenario(edited(weak, "simulation.leaving_domain", "flag")))
    while line.loop.state.flagged is None and line.end < 2.0:
        line.step()
    flag = line.loop.state.flagged
    assert flag is not None
    assert line.loop.warning == f"t = {flag.t:.3f} s: {flag.reason}"
    assert (round(flag.t, 3), "fault") in events(line)
