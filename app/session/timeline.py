"""Timeline of a run: shows the run as it was at any instant, and continues it from there in another way.

Only states are kept, one every `SPACING` s or `PERIODS` periods and one after every change; the rest of the past is
computed again, the same to the last bit.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from dataclasses import dataclass, replace

import numpy as np

from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.simulation.closed_loop import ClosedLoop
from app.simulation.recording import Recording
from app.simulation.state import State
from app.simulation.system import System
from app.storage.session_index import PINS
from environments.push import Grip

SPACING = 0.25  # s, between two states that are kept, and at most
PERIODS = 250  # control periods: with short ones a look back would compute for seconds
MOST_STATES = 6000  # states that are kept; a run with a full recording has 4800, and one for every change
PINNED = 60.0  # s of a run that a pin keeps
BEFORE = 10.0  # s of them that lie before the instant looked at, from which another run goes on
NAME = 24  # letters of the name of a pinned run
USUAL = re.compile(r"run \d+")  # name of a pinned run to which the user has given none


@dataclass(frozen=True)
class _Keyframe:
    """A state of the run. changed: a command had acted on the loop just before."""

    state: State
    system: System
    changed: bool


@dataclass(frozen=True)
class Pinned:
    """A run as it was when it was pinned, up to t (s): its last minute, or that about the instant looked at.
    name: as the user calls it, "" for none.
    slot: which of the `PINS` slots it has, counted from 0; it decides its colour."""

    number: int
    system: System
    recording: Recording
    t: float
    name: str = ""
    slot: int = 0

    @property
    def title(self) -> str:
        """Name of the pinned run, by default made from its number."""
        return self.name or f"run {self.number}"

    def is_like(self, other: Pinned) -> bool:
        """Whether the other one is the same stretch of the same run."""
        if (self.t, len(self.recording), self.scenario) != (other.t, len(other.recording), other.scenario):
            return False
        last, theirs = (run.recording.rows(run.t - SPACING) for run in (self, other))
        return np.array_equal(last, theirs, equal_nan=True)

    @property
    def scenario(self) -> Scenario:
        """Scenario of its last control period: one that has been changed since has not been run yet."""
        now = self.t - 0.5 * self.system.scenario.controller.period
        ran = [epoch.scenario for epoch in self.recording.epochs if epoch.t < now]
        return ran[-1] if ran else self.system.scenario


class Timeline:
    """Timeline of one run; `loop` stands at the instant looked at, the run's end unless somebody looks back. For one
    thread at a time.

    pinned: runs kept for comparison, oldest first.
    forks: instants at which the run went on in another way, s.
    """

    def __init__(self, loop: ClosedLoop) -> None:
        self._end = loop
        self._back: ClosedLoop | None = None
        self.pinned: tuple[Pinned, ...] = ()
        self._pins = 0
        self._begin()

    def _begin(self) -> None:
        self._back = None
        self.forks: tuple[float, ...] = ()
        self._keyframes: list[_Keyframe] = []
        self._keep(changed=True)

    @property
    def loop(self) -> ClosedLoop:
        """The loop at the instant that is looked at."""
        return self._back or self._end

    @property
    def recording(self) -> Recording:
        """Recording of the whole run, whatever instant is looked at."""
        return self._end.recording

    @property
    def end(self) -> float:
        """Last instant of the run, s."""
        return self._end.t

    @property
    def stop(self) -> str:
        """Reason why the run has stopped at its end, "" where it has not."""
        return self._end.stopped or ""

    @property
    def latest(self) -> System:
        """System at the run's end."""
        return self._end.system

    @property
    def first(self) -> float:
        """The earliest instant that can be looked at, s."""
        return self._keyframes[0].state.t

    @property
    def last_change(self) -> float | None:
        """Instant of the last change before the run's end, s, else the earliest known instant; None where there is
        nothing before the end."""
        before = self.end - 0.5 * self.loop.period
        known = [t for t in (self.first, *(epoch.t for epoch in self.recording.epochs)) if self.first <= t < before]
        return max(known, default=None)

    def step(self) -> None:
        """Compute one control period; while looking back the run is only shown again, until its end is reached."""
        if self._back is None:
            self._end.advance()
            if self._end.t >= self._due:
                self._keep(changed=False)
            return
        self._back.advance()
        if self._same(self._back.t, self._end.t):
            self._back = None
        elif (key := self._keyframe_at(self._back.t)).changed and self._same(key.state.t, self._back.t):
            self._back = _resumed(key)

    def seek(self, t: float) -> None:
        """Look at the run as it was at t (s). Raises ScenarioError outside of the known stretch."""
        self.require_known(t)
        half = 0.5 * self.loop.period
        if t > self.end - half:
            self._back = None
            return
        self._back = _resumed(self._keyframe_at(t + half))
        while self._back.t < t - half and self._back.stopped is None:
            self._back.advance()

    def require_known(self, t: float) -> None:
        """Raises ScenarioError unless this run is known at t (s)."""
        half = 0.5 * self.loop.period
        if not self.first - half <= t <= self.end + half:  # also when t is not a number
            raise ScenarioError(
                f"time: {t:g} s; allowed: {self.first:.10g} to {self.end:.10g} s, as far as this run is known"
            )

    def to_end(self) -> None:
        """Look at the run at its end."""
        self._back = None

    def fork(self) -> None:
        """Continue from the instant looked at; the rest of the run is pinned. Raises ScenarioError at the run's end."""
        if self._back is None:
            raise ScenarioError("fork: the run stands at its end; allowed: while looking back")
        self._back.recording = self._so_far(self._back)
        self._go_on(self._back)

    def edit(self, scenario: Scenario) -> bool:
        """Continue with a changed scenario, from the instant looked at; True when the run begins anew or has forked.

        Raises ScenarioError, and then nothing has changed.
        """
        loop, back = self.loop, self._back
        if back is not None:
            back.recording = self._so_far(back)
        before = loop.recording
        over = loop.stopped is not None and len(self.pinned) < PINS  # without removing another pinned run
        left = self._pinned() if len(self.recording) and (back is not None or over) else None
        loop.edit(scenario)
        if loop.recording is not before:
            if left is not None:  # the rest after the instant looked at, or a run that has stopped
                self._add_once(left)
            self._end = loop
            self._begin()
            return True
        if back is None:
            self._keep(changed=True)
        else:
            self._go_on(back)
        return back is not None

    def drag_tool(self, grip: Grip | None) -> None:
        """Let a hand take hold of the tool, or let go (None). The past cannot be pushed: while looking back this does
        nothing."""
        if self._back is None and self._end.grip != grip:
            self._end.drag_tool(grip)
            self._keep(changed=True)

    def reset(self) -> None:
        """Begin the run's scenario anew."""
        self._end.reset()
        self._begin()

    def pin(self, *, may_be_pinned: bool = False) -> None:
        """Keep the run as it is now, for comparison; of more than `PINS` the oldest is removed. One that is pinned
        already stays as it is. Raises ScenarioError where nothing is recorded, and for a run that is pinned already
        unless it may be."""
        if not len(self.recording):
            raise ScenarioError("pin: nothing is recorded yet; allowed: after the first control period")
        same = self._add_once(self._pinned())
        if same is not None and not may_be_pinned:
            raise ScenarioError(
                f"pin: this is pinned already, as {same.title}; allowed: when the run has gone on from there"
            )

    def _pinned(self) -> Pinned:
        end, back = self._end, self._back
        last = end.t if back is None else min(end.t, back.t + PINNED - BEFORE)
        to = np.inf if last == end.t else last
        return Pinned(self._pins + 1, end.system, end.recording.branch(last - PINNED, to), last)

    def _add(self, pinned: Pinned) -> None:
        self._pins = pinned.number
        others = (*self.pinned, pinned)[-PINS:-1]
        free = min(set(range(PINS)) - {other.slot for other in others})
        self.pinned = (*others, replace(pinned, slot=free))

    def _add_once(self, pinned: Pinned) -> Pinned | None:
        """Pin a run unless it is pinned already. Returns the pinned run that it is like, None where it is a new one."""
        same = next((other for other in self.pinned if pinned.is_like(other)), None)
        if same is None:
            self._add(pinned)
        return same

    def unpin(self, number: int) -> None:
        """Forget the pinned run of this number. Raises ScenarioError when there is none."""
        if all(pinned.number != number for pinned in self.pinned):
            known = ", ".join(str(pinned.number) for pinned in self.pinned) or "none is pinned"
            raise ScenarioError(f"forget run: {number}; allowed: {known}")
        self.pinned = tuple(pinned for pinned in self.pinned if pinned.number != number)

    def rename(self, number: int, name: str) -> None:
        """Give the pinned run of this number a name, "" for none. Raises ScenarioError when there is no such run, and
        when the name is too long, or that of another run: also the usual one of a run that is not pinned yet."""
        if len(name) > NAME:
            raise ScenarioError(f"name of run {number}: {len(name)} letters; allowed: at most {NAME}")
        if all(pinned.number != number for pinned in self.pinned):
            raise ScenarioError(f"name of run {number}: there is no such pinned run; allowed: one that is pinned")
        usual, others = f"run {number}", {pinned.title for pinned in self.pinned if pinned.number != number}
        title = name or usual
        if title in others or (USUAL.fullmatch(title) and title != usual):
            raise ScenarioError(f"name of run {number}: {title} is another run; allowed: another name")
        given = "" if name == usual else name  # another number makes another usual name
        self.pinned = tuple(replace(p, name=given) if p.number == number else p for p in self.pinned)

    def adopt(self, pinned: tuple[Pinned, ...]) -> None:
        """Pin runs that were pinned elsewhere; of those pinned here the newest come after them, as far as there are
        places, and get the numbers after theirs. A name that another run has before, or may have, is lost."""
        if not pinned:
            return
        others = max((run.number for run in pinned), default=0)
        here, runs = self.pinned[max(len(self.pinned) + len(pinned) - PINS, 0) :], list[Pinned]()
        renumbered = (replace(run, number=number) for number, run in enumerate(here, start=others + 1))
        names = set[str]()
        for run in (*pinned, *renumbered)[-PINS:]:
            name = "" if run.name in names or USUAL.fullmatch(run.name) else run.name
            names.add(name)
            runs.append(replace(run, name=name, slot=len(runs)))
        self.pinned = tuple(runs)
        self._pins = max((run.number for run in self.pinned), default=self._pins)

    def _so_far(self, loop: ClosedLoop) -> Recording:
        """The run's recording up to the instant of a loop that looks back, with the epoch of that loop."""
        recording, now = self.recording.branch(-np.inf, loop.t - 0.5 * loop.period), loop.state.epoch
        while recording.epochs and recording.epochs[-1].t >= now.t:
            recording.epochs.pop()  # this epoch with a blend that was planned later, or one that begins at this instant
        recording.epochs.append(now)
        return recording

    def _go_on(self, loop: ClosedLoop) -> None:
        """Make this loop, which looks back, the end; no hand holds its tool."""
        if len(self.recording):
            self._add_once(self._pinned())
        loop.drag_tool(None)
        while self._keyframes and self._keyframes[-1].state.t > loop.t - 0.5 * loop.period:
            self._keyframes.pop()
        self._end, self._back = loop, None
        self.forks = (*(t for t in self.forks if t < loop.t), loop.t)
        self._keep(changed=True)

    def _keep(self, *, changed: bool) -> None:
        key = _Keyframe(self._end.state.copy(), self._end.system, changed)
        if self._keyframes and self._keyframes[-1].state.t == key.state.t:
            self._keyframes.pop()  # of several changes of one instant only the last counts
        self._keyframes.append(key)
        first = self.recording.first
        while len(self._keyframes) > MOST_STATES or (len(self._keyframes) > 1 and self._keyframes[1].state.t <= first):
            del self._keyframes[0]
        # a state holds the delay line of the force sensor: one a period would take gigabytes
        periods = max(PERIODS, len(key.state.reader.memory))
        self._due = key.state.t + min(SPACING, (periods - 0.5) * self._end.period)

    def _keyframe_at(self, t: float) -> _Keyframe:
        """The last key not after t; the first one if there is none."""
        return self._keyframes[max(bisect_right(self._keyframes, t, key=lambda key: key.state.t) - 1, 0)]

    def _same(self, t: float, other: float) -> bool:
        return abs(t - other) < 0.5 * self.loop.period


def _resumed(key: _Keyframe) -> ClosedLoop:
    return ClosedLoop.from_state(key.state, history=1, previous=key.system)
