"""Keys 1, 2, ... and the command palette: every mode and every shipped scenario."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Literal, get_args

from app.dashboard.widgets.fields.controls import Desk
from app.scenario.data import shipped
from app.scenario.schema import Scenario
from app.session.commands import BeginScenario, Edit
from controllers.modes import MODES

_Digit = Literal["1", "2", "3", "4", "5", "6", "7", "8", "9"]


class Shortcuts:
    """Commands that choose a mode by its place in MODES, or begin a scenario by title or name."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        for digit, mode in zip(get_args(_Digit), MODES.values(), strict=False):
            desk.gui.add_command(f"Mode: {mode.label}", hotkey=digit).on_trigger(self._change(mode.name))
        for name, scenario in shipped().items():
            label = f"Scenario: {scenario.title or name}"
            desk.gui.add_command(label, description=name).on_trigger(self._begin(scenario))

    def _change(self, mode: str) -> Callable[[object], Coroutine[None, None, None]]:
        async def change(_: object) -> None:
            self._desk.post(Edit("mode", mode))

        return change

    def _begin(self, scenario: Scenario) -> Callable[[object], Coroutine[None, None, None]]:
        async def begin(_: object) -> None:
            self._desk.post(BeginScenario(scenario))

        return begin
