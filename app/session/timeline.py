"""A run with its past: it can be looked at as it was at any instant, and go on from there another way.

Nothing of the past is stored but a small state every so often and after every change; the rest is computed again, and
comes out the same to the last bit.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from app.scenario.schema import Scenario, ScenarioError
from app.simulation.closed_loop import ClosedLoop
from app.simulation.recording import Recording
from app.simulation.state import State
from app.simulation.system import System
from app.storage.session_index import PINS
from environments.push import Grip

SPACING = 0.25  # s, between two states that are kept
MOST = 6000  # states that are kept; a run of which all is known has 4800, and one for every change
PINNED = 60.0  # s, of a run that a pin keeps


@dataclass(frozen=True)
class _Key:
    """A state of the run. changed: somebody had acted on the loop just before."""

    state: State
    system: System
    changed: bool


@dataclass(frozen=True)
class Pinned:
    """A run as it was when it was pinned: its last minute, up to t (s); number: what it is called."""

    number: int
    system: System
    recording: Recording
    t: float

    @property
    def scenario(self) -> Scenario:
        return self.system.scenario


class Timeline:
    """One run: `loop` is where it is looked at, which is its end unless one looks back. One thread at a time."""

    def __init__(self, loop: ClosedLoop) -> None:
        self._end = loop
        self._back: ClosedLoop | None = None
        self.pinned: tuple[Pinned, ...] = ()
        self._pins = 0
        self._begin()

    def _begin(self) -> None:
        self._back = None
        self._keys: list[_Key] = []
        self._keep(changed=True)

    @property
    def loop(self) -> ClosedLoop:
        """Where the run is looked at."""
        return self._back or self._end

    @property
    def recording(self) -> Recording:
        """Of the whole run, whatever is looked at."""
        return self._end.recording

    @property
    def end(self) -> float:
        """How far the run has come, s."""
        return self._end.t

    @property
    def first(self) -> float:
        """The earliest instant that can be gone back to, s."""
        return self._keys[0].state.t

    def step(self) -> None:
        """One control period; while looking back the run is only shown again, until it has come to its end."""
        if self._back is None:
            self._end.advance()
            if self._end.t - self._keys[-1].state.t >= SPACING:
                self._keep(changed=False)
            return
        self._back.advance()
        if self._same(self._back.t, self._end.t):
            self._back = None
        elif (key := self._key_at(self._back.t)).changed and self._same(key.state.t, self._back.t):
            self._back = _resumed(key)

    def seek(self, t: float) -> None:
        """Look at the run as it was at t (s). Raises ScenarioError outside of what is known."""
        half = 0.5 * self.loop.period
        if not self.first - half <= t <= self.end + half:  # also when t is not a number
            raise ScenarioError(
                f"time: {t:g} s; allowed: {self.first:g} to {self.end:g} s, as far as this run is known"
            )
        if t > self.end - half:
            self._back = None
            return
        self._back = _resumed(self._key_at(t + half))
        while self._back.t < t - half and self._back.stopped is None:
            self._back.advance()

    def to_end(self) -> None:
        """Look at the run where it has come to."""
        self._back = None

    def fork(self) -> None:
        """Go on from the instant looked at; what followed is pinned. Raises ScenarioError at the run's end."""
        if self._back is None:
            raise ScenarioError("fork: the run stands at its end; allowed: while looking back")
        self._back.recording = self._so_far(self._back)
        self._go_on(self._back)

    def edit(self, scenario: Scenario) -> bool:
        """Go on with a changed scenario, from the instant looked at; True when it begins anew or has forked.

        Raises ScenarioError, and then nothing has changed.
        """
        loop, back = self.loop, self._back
        if back is not None:
            back.recording = self._so_far(back)
        before = loop.recording
        over = loop.stopped is not None and len(self.pinned) < PINS  # which takes no other's place
        left = self._pinned() if len(self.recording) and (back is not None or over) else None
        loop.edit(scenario)
        if loop.recording is not before:
            if left is not None:  # what followed the instant looked at, or a run that has stopped
                self._add(left)
            self._end = loop
            self._begin()
            return True
        if back is None:
            self._keep(changed=True)
        else:
            self._go_on(back)
        return back is not None

    def hold(self, grip: Grip | None) -> None:
        """A hand takes hold of the tool, or lets go (None). What has been cannot be pushed: there it does nothing."""
        if self._back is None and self._end.grip != grip:
            self._end.hold(grip)
            self._keep(changed=True)

    def reset(self) -> None:
        """Begin the run's scenario anew."""
        self._end.reset()
        self._begin()

    def pin(self) -> None:
        """Keep the run as it is now, for comparison; the oldest of more than `PINS` goes."""
        if not len(self.recording):
            raise ScenarioError("pin: nothing is recorded yet; allowed: after the first control period")
        self._add(self._pinned())

    def _pinned(self) -> Pinned:
        end = self._end
        return Pinned(self._pins + 1, end.system, end.recording.branch(end.t - PINNED, np.inf), end.t)

    def _add(self, pinned: Pinned) -> None:
        self._pins = pinned.number
        self.pinned = (*self.pinned, pinned)[-PINS:]

    def unpin(self, number: int) -> None:
        """Forget that pinned run. Raises ScenarioError when there is none."""
        if all(pinned.number != number for pinned in self.pinned):
            known = ", ".join(str(pinned.number) for pinned in self.pinned) or "none is pinned"
            raise ScenarioError(f"unpin: {number}; allowed: {known}")
        self.pinned = tuple(pinned for pinned in self.pinned if pinned.number != number)

    def adopt(self, pinned: tuple[Pinned, ...]) -> None:
        """Runs pinned elsewhere take the places of those that are pinned here."""
        self.pinned = pinned[-PINS:]
        self._pins = max((run.number for run in self.pinned), default=self._pins)

    def _so_far(self, loop: ClosedLoop) -> Recording:
        """The run's recording up to where that loop stands, in the epoch that it is in."""
        recording, now = self.recording.branch(-np.inf, loop.t - 0.5 * loop.period), loop.state.epoch
        if not recording.epochs or recording.epochs[-1].t < now.t:  # it has begun just here
            recording.epochs.append(now)
        return recording

    def _go_on(self, loop: ClosedLoop) -> None:
        """Make this loop, which looks back, the end; no hand holds its tool."""
        self.pin()
        loop.hold(None)
        while self._keys and self._keys[-1].state.t > loop.t - 0.5 * loop.period:
            self._keys.pop()
        self._end, self._back = loop, None
        self._keep(changed=True)

    def _keep(self, *, changed: bool) -> None:
        key = _Key(self._end.state.copy(), self._end.system, changed)
        if self._keys and self._keys[-1].state.t == key.state.t:
            self._keys.pop()  # of several changes of one instant only the last counts
        self._keys.append(key)
        while len(self._keys) > MOST or (len(self._keys) > 1 and self._keys[1].state.t <= self.recording.first):
            del self._keys[0]

    def _key_at(self, t: float) -> _Key:
        """The last one not after t; the first one if there is none."""
        return self._keys[max(bisect_right(self._keys, t, key=lambda key: key.state.t) - 1, 0)]

    def _same(self, t: float, other: float) -> bool:
        return abs(t - other) < 0.5 * self.loop.period


def _resumed(key: _Key) -> ClosedLoop:
    return ClosedLoop.resume(key.state, history=1, previous=key.system)
