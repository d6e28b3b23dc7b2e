"""Tab Runs: pinned runs that are named and forgotten, and the instants that its table compares."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Any, cast

import pytest

from app.dashboard.panels import runs
from app.dashboard.panels.runs import RunsPanel, _note
from app.dashboard.theme.style import ENTERED
from app.dashboard.view_options import Viewing
from app.session.commands import Pin, StepOnce, Unpin
from tests.support.page_stand_in import VISITOR, Page, Widget


def runs_of_page(monkeypatch: pytest.MonkeyPatch) -> tuple[Page, list[float], RunsPanel]:
    """Page with the panel of its runs, and the time (s) by which the panel goes, which a test sets."""
    page, now = Page(), [0.0]
    monkeypatch.setattr(runs.time, "monotonic", lambda: now[0])
    cast(Any, page.desk).viewing = Viewing()
    panel = RunsPanel(page.desk)
    panel._over.value = next(iter(runs.OVER))
    return page, now, panel


def test_a_click_that_comes_late_forgets_no_other_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another page has forgotten a run, or pinned one that takes the place of the oldest, a moment before."""
    page, now, panel = runs_of_page(monkeypatch)
    buttons: dict[str, Widget] = {}

    def pin() -> None:
        page.desk.post(StepOnce())
        page.desk.post(Pin())

    def show() -> list[str]:
        panel.show(page.snapshot())
        shown = {widget.label: widget for widget in page.widgets if widget.visible and "Forget" in widget.label}
        buttons.update(shown)
        return [*shown]

    def click(label: str) -> list[int]:
        asyncio.run(buttons[label].click(VISITOR))
        return [run.number for run in page.snapshot().pinned]

    for _ in range(3):
        pin()
    assert show() == ["Forget run 1", "Forget run 2", "Forget run 3"]
    page.desk.post(Unpin(1))
    assert show() == ["Forget run 2", "Forget run 3"]
    assert click("Forget run 1") == [2, 3]
    assert click("Forget run 2") == [3]
    assert show() == ["Forget run 3"]
    for _ in range(2):
        pin()
    now[0] = 2.0
    assert show() == ["Forget run 4", "Forget run 5", "Forget run 3"]
    late = buttons["Forget run 3"]
    pin()  # of more than three the oldest goes
    assert show() == ["Forget run 4", "Forget run 5"]
    asyncio.run(late.click(VISITOR))
    assert [run.number for run in page.snapshot().pinned] == [4, 5, 6]
    now[0] = 4.0
    assert show() == ["Forget run 4", "Forget run 5", "Forget run 6"]
    assert click("Forget run 6") == [4, 5]


def test_an_emptied_name_of_a_run_is_a_cancel_and_a_half_typed_one_goes_away(monkeypatch: pytest.MonkeyPatch) -> None:
    page, now, panel = runs_of_page(monkeypatch)
    text = panel._rows[0]._text
    page.desk.post(StepOnce())
    page.desk.post(Pin())

    def shown_after(seconds: float) -> str:
        now[0] += seconds
        panel.show(page.snapshot())
        return text.value

    assert shown_after(0.0) == "run 1"
    page.give(text, f"stiff{ENTERED}")
    assert shown_after(2.0) == "stiff"
    page.give(text, "sti")
    page.give(text, ENTERED)  # as Esc sends it
    assert text.value == "stiff"
    assert [run.name for run in page.snapshot().pinned] == ["stiff"]
    page.give(text, "half")
    assert shown_after(50.0) == "half"
    assert shown_after(20.0) == "stiff"  # its page has closed
    page.give(text, f"run 1{ENTERED}")
    assert [run.name for run in page.snapshot().pinned] == [""]
    assert shown_after(2.0) == "run 1"


def test_the_note_on_a_pinned_run_says_how_to_see_both() -> None:
    page = Page()
    assert "press reset (R)" in _note(page.snapshot(), 8.0, "own")
    page.desk.post(StepOnce())
    page.desk.post(Pin())
    assert _note(page.snapshot(), 8.0, "own").startswith("run 1 ends at 0.00 s: ")
    page.desk.post(StepOnce())
    assert "press reset (R)" in _note(page.snapshot(), 8.0, "own")


def test_the_same_instants_are_those_that_every_run_has() -> None:
    """A pinned run keeps its last minute only, and the present one may not have come that far."""
    page = Page()
    for _ in range(50):
        page.desk.post(StepOnce())
    page.desk.post(Pin())
    snapshot = page.snapshot()
    (pinned,) = snapshot.pinned
    period = snapshot.scenario.controller.period
    late = replace(pinned, recording=pinned.recording.branch(0.0, pinned.t))
    late.recording._blocks[0].rows[: late.recording._blocks[0].filled, 0] += 20 * period
    first = late.recording.first
    assert first == pytest.approx(20 * period)
    beside = replace(snapshot, pinned=(late,))
    assert _note(beside, 8.0, "own").endswith(
        "Last 8 s of each run, or all of a shorter one with its beginning; in brackets: compared with the present run."
    )
    assert _note(beside, 0.5 * period, "own").endswith("s of each run; in brackets: compared with the present run.")
    assert f"t = {first:.2f} to {snapshot.t:.2f} s, the last instants that all runs have" in _note(beside, 8.0, "same")
    early = replace(beside, t=10 * period)
    assert _note(early, 8.0, "own").startswith(f"run 1 is kept from {first:.2f} s on: it appears in 0 s. ")
    said = _note(early, 8.0, "same")
    assert f"No instant is in all runs: the present run ends at {early.t:.2f} s, run 1 is kept from" in said
