"""Playback: the buttons that are always visible, and their keys."""

from __future__ import annotations

import viser

from app.dashboard.controls import Desk
from app.runner import Pause, Play, Reset, SetSpeed, Snapshot, StepOnce

_SPEEDS = {"1/20×": 0.05, "1/5×": 0.2, "1/2×": 0.5, "1×": 1.0, "2×": 2.0, "5×": 5.0, "10×": 10.0}


class Playback:
    """Play or pause, one step, back to the start, speed; Space, → and R do the same."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        gui = desk.gui
        self._run = gui.add_button_group("Run", ("play / pause", "step", "reset"), hint="Keys: space, →, R")
        self._run.on_click(self._on_run)
        self._speed = gui.add_dropdown("Speed", tuple(_SPEEDS), initial_value="1×", hint="Simulated over real time.")
        self._speed.on_update(self._on_speed)
        gui.add_command("Play / pause", hotkey="space").on_trigger(self._toggle)
        gui.add_command("One control period", hotkey="arrowright").on_trigger(self._step)
        gui.add_command("Back to the start", hotkey="R").on_trigger(self._reset)

    async def _on_run(self, event: viser.GuiEvent) -> None:
        actions = {"play / pause": self._toggle, "step": self._step, "reset": self._reset}
        await actions[event.target.value](event)

    async def _toggle(self, _: object) -> None:
        self._desk.post(Pause() if self._desk.snapshot().phase == "running" else Play())

    async def _step(self, _: object) -> None:
        self._desk.post(StepOnce())

    async def _reset(self, _: object) -> None:
        self._desk.post(Reset())

    async def _on_speed(self, event: viser.GuiEvent) -> None:
        if event.client is not None:
            self._desk.post(SetSpeed(_SPEEDS[self._speed.value]))

    def show(self, snapshot: Snapshot) -> None:
        self._speed.value = min(_SPEEDS, key=lambda title: abs(_SPEEDS[title] - snapshot.speed))
