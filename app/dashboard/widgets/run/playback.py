"""Playback: the timeline under the scene, with its buttons, the time, the speed and their keys."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from html import escape
from typing import Literal, NamedTuple

from app.analysis.run_events import Event, RunEvents
from app.dashboard.theme.style import COMMITS, ESCAPED, MOVED, RELEASED, SWEPT, without_marks
from app.dashboard.transport.page_values import PageEvent, from_pages
from app.dashboard.widgets.fields.controls import AwaitedAnswer, Desk, asked
from app.dashboard.widgets.fields.field_words import field_in_words
from app.scenario.units import Units
from app.session.commands import Command, Fork, Pause, Pin, Play, Reset, Seek, SetSpeed, StepOnce, ToEnd
from app.session.snapshot import Snapshot

_SPEEDS = {"1/20×": 0.05, "1/5×": 0.2, "1/2×": 0.5, "1×": 1.0, "2×": 2.0, "5×": 5.0, "10×": 10.0}
_STRIDE = 0.1  # s, step of an arrow key with Shift
NAMED = 3  # fields that a tick names
ROOM = 400  # letters of a tick that tells of several events
APART = 0.025  # share of the timeline, the least distance between two ticks of one kind
_SAME = 1e-3  # s: the nearest event counts as the instant looked at up to this distance


def _toggled(snapshot: Snapshot) -> Command:
    return Pause() if snapshot.phase == "running" else Play()


def _moved(snapshot: Snapshot, by: float) -> Command:
    """Command to look at another instant, not beyond the run's ends. by: s later, negative for earlier."""
    t = snapshot.t + by
    return Seek(max(t, snapshot.first)) if t < snapshot.end else ToEnd()


@dataclass(frozen=True)
class _Action:
    """Action of a key and of an entry in the command palette; with an icon, also of a button of the timeline.
    title: in the palette.
    name: of the button.
    icon: its drawing, a path of SVG in a square of 24; "" for no button."""

    title: str
    command: Callable[[Snapshot], Command]
    key: Literal["space", "arrowleft", "arrowright", "R", "F", "end", "P"]
    modifier: Literal["shift"] | None = None
    name: str = ""
    icon: str = ""


_PLAYING, _PAUSED = "M6 4h4v16H6zM14 4h4v16h-4z", "M7 4l13 8-13 8z"
_ACTIONS = (
    _Action("Reset: begin again at t = 0", lambda _: Reset(), "R", name="reset", icon="M4 5h2v14H4zM20 5v14L9 12z"),
    _Action(
        "One control period back",
        lambda s: _moved(s, -s.scenario.controller.period),
        "arrowleft",
        name="back",
        icon="M17 5v14L6 12z",
    ),
    _Action("Play or pause", _toggled, "space", name="play / pause", icon=_PAUSED),
    _Action("One control period on", lambda _: StepOnce(), "arrowright", name="step", icon="M7 5v14l11-7z"),
    _Action("To the end of the run", lambda _: ToEnd(), "end", name="to the end", icon="M18 5h2v14h-2zM4 5v14l11-7z"),
    _Action(
        "Fork: from now on, play continues at the shown instant; what followed is pinned",
        lambda _: Fork(),
        "F",
        name="fork here",
        icon="M6 3h2v7.5c1-2 3-3 8-3.6V4l5 4-5 4V9c-6 .7-8 2-8 6v6H6z",
    ),
    _Action(
        "Pin this run, to compare it with others",
        lambda _: Pin(),
        "P",
        name="pin",
        icon="M8 3h8v2l-1 1v5l3 3v2h-5v5l-1 1-1-1v-5H6v-2l3-3V6L8 5z",
    ),
    _Action("A tenth of a second on", lambda s: _moved(s, _STRIDE), "arrowright", "shift"),
    _Action("A tenth of a second back", lambda s: _moved(s, -_STRIDE), "arrowleft", "shift"),
)
# pressing a button sends its key: `static/page/keys.js`
_PRESSED = {"space": " ", "arrowleft": "ArrowLeft", "arrowright": "ArrowRight", "end": "End"}


class Playback:
    """Timeline under the scene: buttons to play or pause, make one step, reset, look back, fork and pin; the
    speed; the time as a slider over the recorded part of the run; above it a tick for each event."""

    def __init__(self, desk: Desk) -> None:
        self._desk, self._events = desk, RunEvents()
        self._instants: tuple[float, ...] = ()
        gui = desk.gui
        gui.add_html(_buttons_html())
        self._speed = gui.add_dropdown("Speed", tuple(_SPEEDS), initial_value="1×", hint="Simulated over real time.")
        self._speed.on_update(from_pages(self._on_speed))
        self._ticks = gui.add_html("")
        self._time = _Time(desk)
        for action in _ACTIONS:
            entry = gui.add_command(action.title, hotkey=action.key, modifier=action.modifier)
            entry.on_trigger(self._posting(action))
        gui.add_command("Previous event", hotkey="pageup").on_trigger(self._to_event_before)
        gui.add_command("Next event", hotkey="pagedown").on_trigger(self._to_event_after)

    def _posting(self, action: _Action) -> Callable[[object], Coroutine[None, None, None]]:
        async def on_trigger(_: object) -> None:
            self._desk.post(action.command(self._desk.snapshot()))

        return on_trigger

    async def _to_event_before(self, _: object) -> None:
        snapshot = self._desk.snapshot()
        if earlier := [t for t in self._instants if snapshot.first <= t < snapshot.t - _SAME]:
            self._desk.post(Seek(max(earlier)))

    async def _to_event_after(self, _: object) -> None:
        t = self._desk.snapshot().t
        later = [instant for instant in self._instants if instant > t + _SAME]
        self._desk.post(Seek(min(later)) if later else ToEnd())

    async def _on_speed(self, _: PageEvent) -> None:
        if (factor := _SPEEDS.get(self._speed.value)) is not None:  # else the one that runs was chosen again
            self._desk.post(SetSpeed(factor))

    def show(self, snapshot: Snapshot) -> None:
        events = self._events.of(snapshot.recording, snapshot.end, snapshot.state.flagged, snapshot.forks)
        if snapshot.stop:
            events = (*events, Event(snapshot.end, "fault", f"stopped: {snapshot.stop}"))
        self._instants = tuple(event.t for event in events)
        if (ticks := _ticks_html(snapshot, events)) != self._ticks.content:
            self._ticks.content = ticks
        self._show_speed(snapshot.speed)
        self._time.show(snapshot)

    def _show_speed(self, speed: float) -> None:
        """Show the speed; one that is not in the menu, as that of a slow motion, is there as long as it holds."""
        title = next((title for title, factor in _SPEEDS.items() if factor == speed), _speed_title(speed))
        options = tuple(sorted({*_SPEEDS, title}, key=lambda each: _SPEEDS.get(each, speed)))
        # viser chooses the first entry where the chosen one goes
        if title not in self._speed.options:
            self._speed.options = (*self._speed.options, title)
        self._speed.value = title
        if self._speed.options != options:
            self._speed.options = options


def _speed_title(speed: float) -> str:
    times = max(speed, 1.0 / speed)
    text = f"{times:.0f}" if times >= 10.0 else f"{times:.2g}"  # the menu is narrow
    return f"1/{text}×" if speed < 1.0 else f"{text}×"


def _buttons_html() -> str:
    """Buttons of the timeline as HTML. They are sent once, so that a button keeps the focus and is not replaced under
    the mouse; the icon of play / pause follows the phase in the status line by the style sheet (page.css)."""
    buttons = []
    for action in (action for action in _ACTIONS if action.icon):
        key = _PRESSED.get(action.key, action.key.lower())
        shown = {"space": "space", "arrowleft": "←", "arrowright": "→", "end": "End"}.get(action.key, action.key)
        face = _face(action.icon, action.name)
        if action.key == "space":
            play, pause = _face(_PAUSED, "play"), _face(_PLAYING, "pause")
            face = f'<i class="vs-to-play">{play}</i><i class="vs-to-pause">{pause}</i>'
        buttons.append(
            f'<button data-key="{key}" aria-label="{action.name}" title="{action.title} ({shown})">{face}</button>'
        )
    return f'<div class="vs-timeline" role="toolbar" aria-label="timeline">{"".join(buttons)}</div>'


def _face(icon: str, name: str) -> str:
    return f'<svg viewBox="0 0 24 24" aria-hidden="true"><path d="{icon}"/></svg><span>{name}</span>'


def _ticks_html(snapshot: Snapshot, events: tuple[Event, ...]) -> str:
    """Ticks of the events in the recorded part of the run, as HTML; a pressed tick shows its instant."""
    known = snapshot.end - snapshot.first
    places = ((event, (event.t - snapshot.first) / known) for event in events if known > 0.0)
    ticks = "".join(
        f'<i class="vs-tick vs-{event.kind}" data-seek="{event.t:.4f}" style="left:{position:.1%}" '
        f'title="{escape(description)}"></i>'
        for event, position, description in apart(
            [place for place in places if 0.0 <= place[1] <= 1.0], snapshot.latest.units
        )
    )
    return f'<div class="vs-ticks" data-live>{ticks}</div>'


class Tick(NamedTuple):
    """Tick of an event. position: on the timeline. description: what happened, also just before, in words."""

    event: Event
    position: float
    description: str


def apart(places: list[tuple[Event, float]], units: Units) -> list[Tick]:
    """Ticks that are at least `APART` from the next one of their kind, so that each can be pressed; that one tells of
    the nearer ones, too, as far as it has room.
    places: events and their positions as shares of the timeline, in order of time.
    units: of the task space."""
    following: dict[str, int] = {}  # number of the last tick of each kind
    ticks: list[Tick] = []
    for event, position in reversed(places):
        number = following.get(event.kind)
        if number is None or ticks[number].position - position >= APART:
            following[event.kind] = len(ticks)
            ticks.append(Tick(event, position, _event_text(event, units)))
        elif len(ticks[number].description) < ROOM:
            ticks[number] = ticks[number]._replace(
                description=f"{_event_text(event, units)}\n{ticks[number].description}"
            )
    return ticks[::-1]


def _event_text(event: Event, units: Units) -> str:
    words = [field_in_words(path, value, units) for path, value in event.changed[:NAMED]]
    more = ["…"] if len(event.changed) > NAMED else []
    return f"{event.t:.2f} s: {'; '.join(words + more) or event.what}"


class _Time:
    """Control of the instant looked at: a number, and a slider over the recorded part of the run."""

    def __init__(self, desk: Desk) -> None:
        self._desk, self._answer = desk, AwaitedAnswer()
        hint = "Look back: the run pauses, and arm, forces and plots show this instant. Play shows the run again."
        with desk.gui.add_form(None):
            self._text = desk.gui.add_text("time t [s]", "", hint=hint)
            self._slider = desk.gui.add_slider("", 0.0, 1.0, 0.0005, 1.0, marks=(), hint=hint)
        self._text.on_update(from_pages(self._on_text))
        self._slider.on_update(from_pages(self._on_slider))

    async def _on_text(self, _: PageEvent) -> None:
        snapshot, text = self._desk.snapshot(), without_marks(self._text.value).strip()
        if self._text.value.endswith((RELEASED, ESCAPED, SWEPT, MOVED)):
            self._text.value = text
        elif not self._text.value.endswith(COMMITS):
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

    async def _on_slider(self, _: PageEvent) -> None:
        snapshot, position = self._desk.snapshot(), self._slider.value
        t = snapshot.first + position * (snapshot.end - snapshot.first)
        self._text.value = _written(t)
        asked(self._desk, snapshot, Seek(t), self._answer)

    def show(self, snapshot: Snapshot) -> None:
        if self._answer.awaited(snapshot):
            return
        # not while the run goes on: a changing value would overwrite the text being typed; the status line has the time
        self._text.value = "" if snapshot.phase == "running" else _written(snapshot.t)
        known = snapshot.end - snapshot.first
        self._slider.value = (snapshot.t - snapshot.first) / known if snapshot.looking_back else 1.0


def _written(t: float) -> str:
    return f"{t:.3f}"
