"""Complaint over the scene: how long a refusal is shown."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest

from app.dashboard.transport.callback_errors import guarded
from app.dashboard.widgets.page.complaint import SHOWN, Complaint
from app.scenario.data import load
from app.session.commands import DropWayOut
from app.session.runner import Runner
from app.session.snapshot import Snapshot, snapshot_of
from app.session.ways_out import WayOut
from app.simulation.closed_loop import ClosedLoop


@pytest.fixture
def complaint(monkeypatch: pytest.MonkeyPatch) -> tuple[Complaint, Snapshot]:
    """A complaint, and a snapshot whose edit was refused just now."""
    snapshot = snapshot_of(ClosedLoop.from_scenario(load("planar2r-semicircle")))
    runner = Runner.__new__(Runner)  # of a run that stands still
    monkeypatch.setattr(Runner, "snapshot", snapshot, raising=False)
    monkeypatch.setattr(Runner, "posted", 0, raising=False)
    return Complaint(runner), replace(snapshot, refusal="motion.radius: -1; allowed: a number >= 0", refusal_number=1)


def test_a_refusal_is_shown_for_a_while_and_called_as_on_the_page(complaint: tuple[Complaint, Snapshot]) -> None:
    shown, refused = complaint
    now = time.monotonic()
    assert shown.text(refused, now) == "Refused: radius (desired motion): −1; allowed: at least 0"
    assert shown.text(refused, now + 0.5 * SHOWN)
    assert not shown.text(refused, now + 2.0 * SHOWN)


def test_a_failure_that_no_page_has_drawn_waits_for_one(complaint: tuple[Complaint, Snapshot]) -> None:
    """Nobody looked when the session could not be saved: who comes later is told."""
    shown, refused = complaint
    now = time.monotonic()
    shown.text(refused, now)
    shown.fail("the session cannot be saved")
    later = now + 100.0 * SHOWN
    assert shown.text(refused, later) == "Failed: the session cannot be saved"
    assert shown.text(refused, later + 0.5 * SHOWN)
    assert not shown.text(refused, later + 1.5 * SHOWN)


def test_a_refusal_is_shown_as_long_as_its_way_out_is_offered(complaint: tuple[Complaint, Snapshot]) -> None:
    shown, refused = complaint
    offering = replace(refused, way_out=WayOut("Take 0, the smallest allowed", refused.scenario))
    now = time.monotonic()
    shown.text(offering, now)
    assert shown.text(offering, now + 10.0 * SHOWN)
    assert not shown.text(refused, now + 10.0 * SHOWN)  # it was dropped
    assert not shown.text(replace(offering, way_out=None, revision=offering.revision + 1), now)  # another edit


@pytest.mark.faults
def test_a_failure_is_no_refusal_and_leaves_the_way_out(
    complaint: tuple[Complaint, Snapshot], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A callback of the page fails while a way out is offered: it is said as a failure, then the refusal again."""
    shown, refused = complaint
    posted: list[object] = []
    monkeypatch.setattr(Runner, "post", lambda _, command: posted.append(command))
    offering = replace(refused, way_out=WayOut("Take 0, the smallest allowed", refused.scenario))
    now = time.monotonic()
    refusal = shown.text(offering, now)
    guarded(lambda: 1 / 0, shown.tell)()
    assert shown.text(offering, now).startswith("Failed: the page could not carry that out (ZeroDivisionError")
    assert posted == []
    assert shown.text(offering, now + 1.5 * SHOWN) == refusal
    shown.tell("time t [s]: 'x' is not a number; allowed: such as 1.5")
    assert shown.text(offering, now).startswith("Refused: time t [s]")
    assert posted == [DropWayOut()]


def test_a_refused_answer_is_taken_back_when_a_valid_one_came(
    complaint: tuple[Complaint, Snapshot], monkeypatch: pytest.MonkeyPatch
) -> None:
    """So is a refusal by the runner, with its way out, when the value in force is typed again."""
    shown, refused = complaint
    monkeypatch.setattr(Runner, "post", lambda *_: None)
    now = time.monotonic()
    before = replace(refused, refusal_number=0)
    shown.refuse("your answer: 'x'; allowed: a number, such as 12.5")
    assert shown.text(before, now) == "Refused: your answer: 'x'; allowed: a number, such as 12.5"
    shown.withdraw()
    assert not shown.text(before, now)
    offering = replace(refused, way_out=WayOut("Take 0, the smallest allowed", refused.scenario))
    assert shown.text(offering, now)
    shown.withdraw()
    assert not shown.text(replace(refused, way_out=None), now)
