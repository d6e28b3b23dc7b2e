"""Events of a run, the ticks of its timeline: changes, pushes, contacts, forks and faults, each with its instant."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from app.analysis.metrics import MULTIPLIERS
from app.scenario.data import differences
from app.scenario.schema import Scenario
from app.simulation.builders.environment_builder import push_of
from app.simulation.recording import Epoch, Recording
from app.simulation.state import Flag

Kind = Literal["edit", "push", "contact", "fork", "fault"]

APART = 0.1  # s: what a contact does within this after an event of it is told only if it stays so
WHICH = ("", ", second surface", ", third surface")  # by a surface's index
MOST = 400  # events of pushes and contacts, the newest
MOST_NAMED = 3  # changed fields that an edit names


@dataclass(frozen=True)
class Event:
    """Something that happened at t (s), in a few words. changed: fields that an edit changed, by dotted path, with
    their new values."""

    t: float
    kind: Kind
    what: str
    changed: tuple[tuple[str, object], ...] = ()


@dataclass
class _Contact:
    """Contact with a surface.
    reported: whether the last event of it said that the tool touches the surface, or whether it did at first.
    now: whether it does.
    at, since: instants of that event and of the last change, s."""

    reported: bool
    now: bool
    at: float = -np.inf
    since: float = -np.inf


class RunEvents:
    """Events of a growing recording; each call of `of` reads only the rows and changes that are new since the last."""

    def __init__(self) -> None:
        self._recording: Recording | None = None
        self._felt: list[Event] = []
        self._flags: dict[Flag, None] = {}
        self._edited: dict[int, tuple[Epoch, Event | None]] = {}  # by the id of an epoch that is kept with it

    def of(self, recording: Recording, end: float, flag: Flag | None, forks: tuple[float, ...]) -> tuple[Event, ...]:
        """All events up to now, in the order of their instants.
        end: s, the last instant of the run.
        flag: what the run has been flagged for since its last change."""
        if recording is not self._recording:
            before_fork = {each: None for each in self._flags if forks and each.t <= forks[-1]}
            self._recording, self._felt, self._flags, self._edited = recording, [], before_fork, {}
            self._read, self._pushed, self._contacts = -np.inf, False, {}
        if flag is not None:
            self._flags[flag] = None
        self._feel(recording, end)
        faults = [Event(flag.t, "fault", flag.reason) for flag in self._flags]
        forked = [Event(t, "fork", "forked here") for t in forks]
        return tuple(sorted((*self._edits(recording), *self._felt, *forked, *faults), key=lambda event: event.t))

    def _edits(self, recording: Recording) -> list[Event]:
        """Changes of the scenario."""
        known, pairs = self._edited, pairwise(tuple(recording.epochs))
        self._edited = {id(after): known.get(id(after)) or (after, _edit(before, after)) for before, after in pairs}
        return [event for _, event in self._edited.values() if event is not None]

    def _feel(self, recording: Recording, end: float) -> None:
        """Find pushes and contacts in the rows that are new."""
        rows = recording.stretch(np.nextafter(self._read, np.inf), end)
        t = rows["t"]
        if not len(t):
            return
        force, moment = (np.linalg.norm(rows[name], axis=1) for name in ("F_push", "moment_push"))
        pushed, epochs = (force > 0.0) | (moment > 0.0), tuple(recording.epochs)  # a copy: the loop's thread adds
        for i in np.flatnonzero(pushed & ~np.r_[self._pushed, pushed[:-1]]):
            # the oldest that is kept, where the push is older
            scenario = [epoch.scenario for epoch in epochs if epoch.t <= t[i] or epoch is epochs[0]][-1]
            self._felt.append(Event(float(t[i]), "push", _push(scenario, float(t[i]), force[i], moment[i])))
        for name, surface in zip(MULTIPLIERS, epochs[-1].scenario.surfaces, strict=False):
            self._feel_contact(t, rows[name] != 0.0, WHICH[surface.index])
        self._felt.sort(key=lambda event: event.t)
        self._read, self._pushed = float(t[-1]), bool(pushed[-1])
        del self._felt[:-MOST]

    def _feel_contact(self, t: np.ndarray, touching: np.ndarray, which: str) -> None:
        """Find where the contact with a surface begins and ends. t, touching: (N,), of rows that are new."""
        first = bool(touching[0])
        known = self._contacts.setdefault(which, _Contact(reported=first, now=first))
        for i in np.flatnonzero(touching != np.r_[known.now, touching[:-1]]):
            self._settle_contact(known, float(t[i]), which)
            known.now, known.since = bool(touching[i]), float(t[i])
        self._settle_contact(known, float(t[-1]), which)

    def _settle_contact(self, known: _Contact, t: float, which: str) -> None:
        """Tell of a contact's last change, where it is the first one for a while, or has lasted up to t."""
        if known.now != known.reported and (known.since - known.at > APART or t - known.since > APART):
            known.reported, known.at = known.now, known.since
            self._felt.append(Event(known.since, "contact", f"contact {'made' if known.now else 'lost'}{which}"))


def _push(scenario: Scenario, t: float, force: float, moment: float) -> str:
    """Push that begins at t (s) with this force (N) and moment (N m), in words: a sine by its amplitudes."""
    timed, most = push_of(scenario), ""
    if timed.frequency > 0.0 and timed.at(t) is not None:  # it begins at zero
        force, moment, most = float(np.linalg.norm(timed.force)), float(np.linalg.norm(timed.moment)), "up to "
    by = " and ".join(f"{value:.3g} {unit}" for value, unit in ((force, "N"), (moment, "N·m")) if value > 0.0)
    return f"pushed with {most}{by}"


def _edit(before: Epoch, after: Epoch) -> Event | None:
    """Change from one epoch to the next; None where only a push differs, which is an event itself, or a blend that is
    planned, whose end is one."""
    changed = {
        path: new
        for path, (_, new) in differences(before.scenario, after.scenario).items()
        if not path.startswith(("truth.push", "blend."))
    }
    if not changed:
        return None
    text = ", ".join(f"{path} = {new}" for path, new in list(changed.items())[:MOST_NAMED])
    return Event(after.t, "edit", text + (", …" if len(changed) > MOST_NAMED else ""), tuple(changed.items()))
