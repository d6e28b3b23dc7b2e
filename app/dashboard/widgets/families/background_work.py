"""Base of the controls of a robustness map or a search for gains, which are computed beside the loop."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from typing import Generic, TypeVar

import msgspec

from app.dashboard.transport.page_values import PageEvent, from_pages
from app.dashboard.widgets.families.swept_fields import number_of
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.page.file_delivery import FileDelivery
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.snapshot import Snapshot
from app.sweep.background import Background

EVERY = 0.7  # s, between two updates of the picture
W = TypeVar("W", bound=Background)


class BackgroundWork(ABC, Generic[W]):
    """Base of the controls of a computation beside the loop: a button, the length of the runs, and a picture with marks
    that can be chosen. A subclass adds them among its own controls.

    start, cancel: words on the button.
    """

    def __init__(self, desk: Desk, start: str, cancel: str) -> None:
        self._desk, self._words = desk, (start, cancel)
        self._work: W | None = None
        self._delivery, self._due = FileDelivery(), 0.0

    def _add_length(self) -> None:
        """Add the text field for the length of each run."""
        self._seconds = self._desk.gui.add_text("Each run [s]", "2", hint="0.2 to 10 s.")

    def _add_button(self) -> None:
        """Add the button, and the picture below it."""
        self._button = self._desk.gui.add_button(self._words[0], color="green")
        self._html = self._desk.gui.add_html("")
        self._button.on_click(self._on_button)

    def _add_mark(self, field: str) -> None:
        """Add the hidden text field into which the page's script writes the number of the chosen mark. field: class by
        which the script finds it."""
        self._desk.gui.add_html(f'<i class="{field}"></i>')
        self._mark = self._desk.gui.add_text("", "")
        self._mark.on_update(from_pages(self._on_mark))

    def _length(self) -> float:
        """Length of each run, s. Raises ScenarioError."""
        seconds = number_of("Each run", self._seconds.value)
        if not 0.2 <= seconds <= 10.0:
            raise ScenarioError(f"Each run: {seconds:g} s; allowed: 0.2 to 10 s")
        return seconds

    async def _on_button(self, _: object) -> None:
        if self._work is not None and self._work.going:
            self._work.cancel()
            return
        try:
            self._work = self._begin(self._desk.snapshot())
            self._due = 0.0  # at once, since the marks of the old picture have no meaning any more
        except ScenarioError as error:
            self._desk.complain(str(error))

    @abstractmethod
    def _begin(self, snapshot: Snapshot) -> W:
        """Begin the computation of the present choices. Raises ScenarioError."""

    async def _on_mark(self, event: PageEvent) -> None:
        if self._work is not None:
            self._choose(self._work, self._mark.value.partition(" ")[0], event.client.client_id)

    @abstractmethod
    def _choose(self, work: W, number: str, client: int) -> None:
        """Handle the choice of a mark in the picture. number: of the mark, "" for none. client: whose page it was."""

    def show(self, snapshot: Snapshot) -> None:
        """Show the results so far, every EVERY s."""
        work, now = self._work, time.monotonic()
        if work is None or now < self._due:
            return
        self._due = now + EVERY
        label = self._words[work.going]
        if self._button.label != label:
            self._button.label, self._button.color = label, "gray" if work.going else "green"
        content = self._drawn(work, snapshot)
        if self._html.content != content:
            self._html.content = content

    @abstractmethod
    def _drawn(self, work: W, snapshot: Snapshot) -> str:
        """Picture of the results so far, as HTML."""


def with_least_duration(scenario: Scenario, seconds: float) -> Scenario:
    """The scenario with a duration, s, that is at least this long. A shorter one would have another Omega, and with it
    other constants than the loop on the page."""
    simulation = msgspec.structs.replace(scenario.simulation, duration=max(scenario.simulation.duration, seconds))
    return msgspec.structs.replace(scenario, simulation=simulation)


def task_of(scenario: Scenario) -> tuple[object, ...]:
    """Mode, arm, task coordinates, kinds of surfaces and face of the tool of a scenario, without which the results of
    its runs mean nothing."""
    surfaces = [type(each.form) for each in scenario.surfaces]
    return scenario.mode, scenario.robot, scenario.task_space, surfaces, scenario.face.flat


def earlier_html(what: str) -> str:
    """Note on results of a scenario with another `task_of` than the present one, as HTML."""
    others = "mode, arm, tool, task coordinates or surfaces were others"
    return f'<div class="vs-note">{what} is of an earlier scenario: {others}.</div>'
