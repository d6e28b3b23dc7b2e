"""Controls of the page, typed into and let go by a stand-in for viser: what they show once an edit was answered."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import viser

from app.dashboard.panels.robot import UNSTATED, StatedBounds
from app.dashboard.theme.style import COMMIT, RELEASED
from app.dashboard.widgets.controls import Desk, FieldPlace, NumberField, decades
from app.dashboard.widgets.edit_lock import EditLock
from app.dashboard.widgets.text_field import TextField
from app.dashboard.widgets.whatif import WhatIf
from app.scenario.data import shipped
from app.session.commands import Command, Load
from app.session.preview_client import Previewer
from app.session.runner import Runner
from app.session.snapshot import Snapshot

VISITOR = cast(viser.GuiEvent, SimpleNamespace(client=SimpleNamespace(client_id=1)))


class Widget(SimpleNamespace):
    """Stand-in for a widget of viser: keeps its value and its callback; a folder or form is a context."""

    def on_update(self, update: Callable[[viser.GuiEvent], Any]) -> None:
        self.update = update

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        pass


class Page:
    """Page without a browser, beside a runner that obeys at once.
    widgets: those that were added, in their order."""

    def __init__(self) -> None:
        self.runner = Runner(shipped()["ur5-hybrid"])
        self.widgets: list[Widget] = []
        self.said: list[str] = []
        self.whatif = WhatIf(Previewer())
        self.lock = EditLock(self._obey, self.said.append)
        names = ("add_form", "add_folder", "add_text", "add_slider", "add_html", "add_button")
        gui = SimpleNamespace(**dict.fromkeys(names, self._add))
        self.desk = cast(
            Desk,
            SimpleNamespace(
                gui=gui, post=self.lock.post, snapshot=self.snapshot, complain=self.said.append, lock=self.lock,
                whatif=self.whatif, choose=lambda _: None, sweep=lambda _: None, let_move=lambda _: None,
            ),
        )  # fmt: skip

    def _obey(self, command: Command) -> None:
        self.runner._obey([command])

    def snapshot(self) -> Snapshot:
        return self.runner._publish()

    def _add(self, *_: object, **given: object) -> Widget:
        self.widgets.append(Widget(**{"value": "", "visible": True, "label": "", "disabled": False} | given))
        return self.widgets[-1]

    def give(self, widget: Widget, value: object) -> None:
        """Give a widget a value as a visitor does."""
        widget.value = value
        asyncio.run(widget.update(VISITOR))


def test_a_text_that_was_accepted_follows_the_run_however_it_is_written() -> None:
    page = Page()
    before = page.snapshot().scenario
    field = TextField(page.desk, StatedBounds("declared.delta_G"), "δ_G")
    text = page.widgets[-1]
    page.give(text, f"2.0{COMMIT}")
    assert page.snapshot().scenario.declared.delta_G == 2.0
    field.show(page.snapshot())
    assert text.value == "2"
    page.desk.post(Load(before))
    field.show(page.snapshot())
    assert text.value == UNSTATED
    page.give(text, f"-1{COMMIT}")  # refused: it stays, to be corrected
    field.show(page.snapshot())
    assert text.value == "-1"


def test_a_slider_that_a_lesson_locks_shows_the_running_value_again_and_nothing_as_applied() -> None:
    page = Page()
    field = NumberField(page.desk, FieldPlace("contact.K_e"), "K_e [N/m]", decades(100, 100_000))
    _, text, slider = page.widgets
    field.show(page.snapshot())
    running, place = text.value, slider.value
    page.lock.fields = frozenset({"target_model.B_m"})
    page.give(slider, place - 0.2)
    page.give(text, f"{text.value}{RELEASED}")
    assert page.said == ["contact.K_e: locked by the goal of a lesson; allowed: target_model.B_m, or leave the lesson"]
    assert page.whatif.undo(page.snapshot()) is None
    field.show(page.snapshot())
    assert (text.value, slider.value) == (running, place)
    page.lock.fields = frozenset({"contact.K_e"})
    page.give(slider, place - 0.2)
    page.give(text, f"{text.value}{RELEASED}")
    undo = page.whatif.undo(page.snapshot())
    assert undo is not None
    assert page.snapshot().scenario != shipped()["ur5-hybrid"]
    assert page.desk.post(undo)
    assert page.snapshot().scenario == shipped()["ur5-hybrid"]
