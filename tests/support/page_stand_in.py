"""Page without a browser, with stand-ins for the widgets of viser, beside a runner that obeys at once."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import viser

from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.fields.edit_lock import EditLock
from app.dashboard.widgets.run.whatif import WhatIf
from app.scenario.data import shipped
from app.session.commands import Command
from app.session.preview_client import Previewer
from app.session.runner import Runner
from app.session.snapshot import Snapshot

VISITOR = cast(viser.GuiEvent, SimpleNamespace(client=SimpleNamespace(client_id=1)))


class Widget(SimpleNamespace):
    """Stand-in for a widget of viser: keeps its value and its callback; a folder or form is a context."""

    def on_update(self, update: Callable[[viser.GuiEvent], Any]) -> None:
        self.update = update

    def on_click(self, click: Callable[[viser.GuiEvent], Any]) -> None:
        self.click = click

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
        self.complaints: list[str] = []
        self.whatif = WhatIf(Previewer())
        self.lock = EditLock(self._obey, self.complaints.append)
        names = (
            "add_form",
            "add_folder",
            "add_text",
            "add_slider",
            "add_html",
            "add_button",
            "add_dropdown",
            "add_checkbox",
        )
        gui = SimpleNamespace(**dict.fromkeys(names, self._add))
        self.desk = cast(
            Desk,
            SimpleNamespace(
                gui=gui, post=self.lock.post, snapshot=self.snapshot, complain=self.complaints.append, lock=self.lock,
                withdraw_complaint=lambda: None,
                whatif=self.whatif, choose=lambda _: None, sweep=lambda _: None, let_move=lambda _: None,
            ),
        )  # fmt: skip

    def _obey(self, command: Command) -> int:
        self.runner._obey([command])
        return self.runner._executed

    def snapshot(self) -> Snapshot:
        return self.runner._publish()

    def _add(self, *positional: Any, **given: object) -> Widget:
        usual = {"value": "", "visible": True, "label": "", "disabled": False, "content": "", "options": ()}
        if len(positional) > 1 and isinstance(positional[1], tuple):  # of a menu
            usual["options"] = positional[1]
        self.widgets.append(Widget(**usual | given))
        return self.widgets[-1]

    def give(self, widget: Widget, value: object) -> None:
        """Give a widget a value as a visitor does."""
        widget.value = value
        asyncio.run(widget.update(VISITOR))
