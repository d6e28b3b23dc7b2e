"""The status line's title follows what runs."""

from __future__ import annotations

import re
from dataclasses import replace

import msgspec
import pytest

from app.dashboard.widgets.page.status import status_html
from app.dashboard.widgets.theorem.premise_table import premises_html
from app.scenario.data import edited, load
from app.scenario.schema import Scenario
from app.session.changes import in_mode, on_robot, on_surface
from app.session.snapshot import PREPARING, Snapshot, snapshot_of
from app.simulation.closed_loop import ClosedLoop

SHIPPED = load("ur5-hybrid")
AGAIN = "; all premises hold again since t = "


@pytest.fixture(scope="module")
def snapshot() -> Snapshot:
    return snapshot_of(ClosedLoop.from_scenario(SHIPPED))


def title(snapshot: Snapshot, scenario: Scenario) -> str:
    begun_from = SHIPPED if scenario.name == SHIPPED.name else None
    html = status_html(replace(snapshot, scenario=scenario), "", begun_from)
    found = re.search(r'<span class="vs-title"[^>]*>(.*?)</span></div>', html)
    assert found is not None
    return re.sub(r"<.*?>", "", found[1])


def test_a_title_says_that_the_scenario_was_edited_and_is_another_where_it_would_be_false(snapshot: Snapshot) -> None:
    assert title(snapshot, SHIPPED) == SHIPPED.title
    assert title(snapshot, edited(SHIPPED, "force.value", 25.0)) == f"{SHIPPED.title} edited"
    assert title(snapshot, in_mode(SHIPPED, "motion")) == "Universal Robots UR5: motion, plane edited"
    assert title(snapshot, on_surface(SHIPPED, "sphere")) == (
        "Universal Robots UR5: hybrid position / force, sphere edited"
    )
    assert title(snapshot, on_robot(SHIPPED, "panda")) == "Franka Emika Panda"
    own = msgspec.structs.replace(SHIPPED, name="mine", title="<b>mine</b>")
    assert "&lt;b&gt;mine" in status_html(replace(snapshot, scenario=own), "", None)


def test_what_only_the_next_period_can_judge_is_not_said_to_be_unpromised() -> None:
    """Before the first period, and after an edit while paused; a premise that fails already is said at once."""
    loop = ClosedLoop.from_scenario(SHIPPED)

    def words() -> list[tuple[str, str]]:
        html = status_html(snapshot_of(loop), "") + premises_html(snapshot_of(loop))
        verdict = "not judged yet|promise holds|nothing promised|(?:now|this run): [^<]*"
        return re.findall(rf'vs-chip vs-(\w+)">({verdict})<', html)

    fresh = [("neutral", "not judged yet"), ("neutral", "now: not judged yet")]
    assert words() == fresh
    loop.step()
    assert words() == [("good", "promise holds"), ("good", "now: holds")]
    assert "all premises hold since t = 0 s" in status_html(snapshot_of(loop), "")
    loop.edit(edited(SHIPPED, "force.value", 21.0))
    assert words() == [*fresh, ("good", "this run: holds")]
    loop.step()
    assert "all premises hold since the change at t = 0.001 s" in status_html(snapshot_of(loop), "")
    loop.edit(edited(SHIPPED, "controller.law", "pd-gravity"))
    assert words()[:2] == [("warn", "nothing promised"), ("warn", "now: nothing promised")]
    html = premises_html(snapshot_of(loop))
    assert "torque of the drives" in html
    assert "d covers (17)" not in html  # of a law without d


def test_a_warning_says_when_its_cause_is_over() -> None:
    """Drives that saturate under a strong push, and no longer after it."""
    limits = [120.0] * 6
    pushed = edited(edited(load("ur5-motion"), "truth.push", [0.0, 0.0, -250.0]), "truth.push_duration", 0.1)
    loop = ClosedLoop.from_scenario(edited(edited(pushed, "truth.push_start", 0.2), "truth.torque_limit", limits))
    while not loop.warning and loop.t < 0.4:
        loop.step()
    assert loop.warning is not None
    assert loop.warning in status_html(snapshot_of(loop), "")
    assert AGAIN not in status_html(snapshot_of(loop), "")
    while loop.standing.now.verdict != "holds" and loop.t < 3.0:
        loop.step()
    assert f"{loop.warning}{AGAIN}{loop.promise_record.since:.3f} s" in status_html(snapshot_of(loop), "")


def test_a_run_that_is_being_prepared_does_not_say_that_it_runs(snapshot: Snapshot) -> None:
    html = status_html(replace(snapshot, notice=PREPARING), "")
    assert "preparing" in html
    assert ">running<" not in html
    assert "×</b>" not in html
