"""Playback: the buttons that are always visible, the time, and their keys."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Literal

import viser

from app.dashboard.theme.style import COMMIT, ESCAPED, MARKS, RELEASED
from app.dashboard.widgets.controls import Answer, Desk
from app.session.commands import Command, Fork, Pause, Pin, Play, Reset, Seek, SetSpeed, StepOnce, ToEnd
from app.session.snapshot import Snapshot

_SPEEDS = {"1/20×": 0.05, "1/5×": 0.2, "1/2×": 0.5, "1×": 1.0, "2×": 2.0, "5×": 5.0, "10×": 10.0}
_STRIDE = 0.1  # s, of an arrow key with Shift


def _toggled(snapshot: Snapshot) -> Command:
    return Pause() if snapshot.phase == "running" else Play()


def _moved(snapshot: Snapshot, by: float) -> Command:
    """Command to look so many seconds (s) later or earlier, not beyond the run's ends."""
    t = snapshot.t + by
    return Seek(max(t, snapshot.first)) if t < snapshot.end else ToEnd()


@dataclass(frozen=True)
class _Action:
    """Action of a key, an entry of the palette and a button; no button where `button` is empty."""

    title: str
    button: str
    command: Callable[[Snapshot], Command]
    key: Literal["space", "arrowleft", "arrowright", "R", "F", "end", "P"]
    modifier: Literal["shift"] | None = None


_RUN = (
    _Action("Play / pause", "play / pause", _toggled, "space"),
    _Action("One control period on", "step", lambda _: StepOnce(), "arrowright"),
    _Action("Begin anew", "reset", lambda _: Reset(), "R"),
)
_PAST = (
    _Action("One control period back", "back", lambda s: _moved(s, -s.scenario.controller.period), "arrowleft"),
    _Action("Fork: go on from the instant looked at", "fork here", lambda _: Fork(), "F"),
    _Action("To the end of the run", "to the end", lambda _: ToEnd(), "end"),
    _Action("Pin this run for comparison", "pin", lambda _: Pin(), "P"),
)
_STRIDES = (
    _Action("A tenth of a second on", "", lambda s: _moved(s, _STRIDE), "arrowright", "shift"),
    _Action("A tenth of a second back", "", lambda s: _moved(s, -_STRIDE), "arrowleft", "shift"),
)


class Playback:
    """Buttons to play or pause, make one step, begin anew, look back, fork and pin; the speed, and the time."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        gui = desk.gui
        self._add_buttons("Run", _RUN, "Keys: space, →, R.")
        self._speed = gui.add_dropdown("Speed", tuple(_SPEEDS), initial_value="1×", hint="Simulated over real time.")
        self._speed.on_update(self._on_speed)
        self._time = _Time(desk)
        self._add_buttons(
            "Past",
            _PAST,
            "Back: look one control period earlier (←; with Shift 0.1 s). Fork here (F): go on from the instant looked "
            "at; what followed is pinned. To the end (End): look where the run has come to. Pin (P): keep this run to "
            "compare it with others, see the tab Runs.",
        )
        for action in (*_RUN, *_PAST, *_STRIDES):
            entry = gui.add_command(action.title, hotkey=action.key, modifier=action.modifier)
            entry.on_trigger(self._posting(action))

    def _add_buttons(self, label: str, actions: tuple[_Action, ...], hint: str) -> None:
        group = self._desk.gui.add_button_group(label, tuple(action.button for action in actions), hint=hint)
        by_button = {action.button: action for action in actions}

        async def on_click(event: viser.GuiEvent) -> None:
            self._post(by_button[event.target.value])

        group.on_click(on_click)

    def _posting(self, action: _Action) -> Callable[[object], Coroutine[None, None, None]]:
        async def on_trigger(_: object) -> None:
            self._post(action)

        return on_trigger

    def _post(self, action: _Action) -> None:
        self._desk.post(action.command(self._desk.snapshot()))

    async def _on_speed(self, event: viser.GuiEvent) -> None:
        if event.client is not None:
            self._desk.post(SetSpeed(_SPEEDS[self._speed.value]))

    def show(self, snapshot: Snapshot) -> None:
        self._speed.value = min(_SPEEDS, key=lambda title: abs(_SPEEDS[title] - snapshot.speed))
        self._time.show(snapshot)


class _Time:
    """The instant looked at, as a number and as a slider over the known stretch of the run."""

    def __init__(self, desk: Desk) -> None:
        self._desk, self._answer = desk, Answer()
        hint = "Look back: the run holds, and everything is shown as it was at this instant. Play shows it again."
        with desk.gui.add_form(None):
            self._text = desk.gui.add_text("time t [s]", "", hint=hint)
            self._slider = desk.gui.add_slider("", 0.0, 1.0, 0.0005, 1.0, marks=(), hint=hint)
        self._text.on_update(self._on_text)
        self._slider.on_update(self._on_slider)

    async def _on_text(self, event: viser.GuiEvent) -> None:
        if event.client is None:
            return
        snapshot, text = self._desk.snapshot(), self._text.value.rstrip("".join(MARKS)).strip()
        if self._text.value.endswith((RELEASED, ESCAPED)):
            self._text.value = text
        elif not self._text.value.endswith(COMMIT):
            self._answer.expect(snapshot, seconds=60.0)
        else:
            self._answer.expect(snapshot, seconds=0.0)
            self._ask(text)
            self.show(snapshot)

    def _ask(self, text: str) -> None:
        if not text or text == _written(self._desk.snapshot().t):
            return
        try:
            self._desk.post(Seek(float(text)))
        except ValueError:
            self._desk.complain(f"time t [s]: {text!r:.60} is not a number; allowed: such as 1.5")

    async def _on_slider(self, event: viser.GuiEvent) -> None:
        if event.client is None:
            return
        snapshot, share = self._desk.snapshot(), self._slider.value
        self._answer.expect(snapshot, seconds=0.5)
        t = snapshot.first + share * (snapshot.end - snapshot.first)
        self._text.value = _written(t)
        self._desk.post(Seek(t))

    def show(self, snapshot: Snapshot) -> None:
        if self._answer.awaited(snapshot):
            return
        # while the run goes on, the status line has the time: a changing value would overwrite the text being typed
        self._text.value = "" if snapshot.phase == "running" else _written(snapshot.t)
        known = snapshot.end - snapshot.first
        self._slider.value = (snapshot.t - snapshot.first) / known if snapshot.looking_back else 1.0


def _written(t: float) -> str:
    return f"{t:.3f}"
