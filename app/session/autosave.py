"""Autosave of the session on disk: its scenario and pinned runs, so that a server that is started again can offer them.

A folder has `session.json`, the session of the server that uses it; `offer.json`, that of an earlier server, until it
is restored, refused or replaced; and a file for every pinned run that one of the two names. Each file is there as a
whole or not at all, and an index is written after the files that it names: whenever a process is killed, the folder is
consistent, either as before or as after a change.
"""

from __future__ import annotations

import contextlib
import os
import re
import threading
import time
import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import msgspec
import structlog

from app.process.atomic_write import write_whole
from app.process.base_directory import base_directory
from app.process.json_text import decode_json
from app.scenario.data import from_toml, to_toml
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.snapshot import Snapshot
from app.session.timeline import NAME, Pinned
from app.simulation.closed_loop import ClosedLoop
from app.storage.constants_store import kept_memory
from app.storage.recording_files import read_npz, table, write_npz
from app.storage.session_index import LARGEST, OFFER, SESSION, Index, SavedRun, StateError, decoded, occupied
from environments.regular_file import read_regular

log = structlog.get_logger()

ASIDE = "set-aside-"
EVERY = 0.5  # s between two looks at the run; a change is saved when none has followed for this long
LATEST = 5.0  # s after the first unsaved change, when it is saved even if others keep following
REMINDER = 60.0  # s, until a change that cannot be saved either is complained of again
_PRIVATE = 0o600
# begin the names of files that a killed process has left
UNFINISHED = (".session.json", ".run-", ".class.json", ".lessons.json")
_RUN_FILE = re.compile(r"run-[0-9a-f]{32}\.npz")


@dataclass(frozen=True)
class Offer:
    """Session of an earlier server, offered on the page: its scenario, its pinned runs, when it was saved (s since
    1970)."""

    scenario: Scenario
    runs: tuple[SavedRun, ...]
    saved: float


class _TakenUp(NamedTuple):
    """Offer that has been read for the loop to go on with: its scenario, None where there is none, and its pinned runs
    with the names of their files."""

    scenario: Scenario | None = None
    runs: tuple[tuple[Pinned, str], ...] = ()

    def in_session(self, scenario: Scenario, pinned: tuple[Pinned, ...]) -> bool:
        """Whether a session with this scenario and these pinned runs goes on with it."""
        recordings = [run.recording for run, _ in self.runs]
        return scenario == self.scenario or any(run.recording is known for run in pinned for known in recordings)


class StateFolder:
    """A folder that only this process uses, until it ends or `close` is called.

    `problem` is a sentence about an earlier session that cannot be read, "" where there is none. `continues` says
    whether the process before has saved a session. Not to be used by two threads at once. Raises StateError when
    another process uses the folder or it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path, self._lock = occupied(path)
        self.problem = ""
        self._kept: tuple[tuple[Pinned, str], ...] = ()
        self._indexed = set[str]()  # files that `session.json` names, as this process has written it
        self._taken_up = _TakenUp()
        try:
            self.continues = self._readable(SESSION) is not None
            if self.continues:
                os.replace(self.path / SESSION, self.path / OFFER)
            for file in [file for file in self.path.iterdir() if file.name.startswith(UNFINISHED)]:
                file.unlink(missing_ok=True)  # only now: later other threads of this process write such files
            self._tidy()
        except OSError as error:
            self.close()
            raise StateError(f"--state-dir {path}: cannot be written: {error.strerror}") from error

    def close(self) -> None:
        """Unlock the folder for other processes."""
        os.close(self._lock)

    def offer(self) -> Offer | None:
        """Session of an earlier server, None where there is none that can be read."""
        index = self._readable(OFFER)
        return None if index is None else Offer(from_toml(index.scenario), tuple(index.pinned), index.saved)

    def read_offer(self, offer: Offer) -> tuple[tuple[Pinned, ...], str]:
        """Pinned runs of an offer that is restored, and a sentence about those that cannot be read, which are set
        aside.

        It takes seconds. The offer stays until a session is saved that goes on with it. Raises ScenarioError where the
        offer's scenario cannot run now.
        """
        ClosedLoop.from_scenario(offer.scenario, history=1, memory=kept_memory())
        runs, problems = [], []
        for saved in offer.runs:
            try:
                runs.append((_pinned(saved, self._run_file(saved)), saved.file))
            except Exception as error:  # whatever is in that file: the others, and the scenario, are still good
                reason = str(error) if isinstance(error, ScenarioError | StateError) else f"{type(error).__name__}"
                log.warning("saved run unreadable", file=saved.file, reason=reason)
                self._set_aside(saved)
                problems.append(f"run {saved.number} cannot be shown again: {reason}")
        self._taken_up = _TakenUp(offer.scenario, tuple(runs))
        return tuple(run for run, _ in runs), "; ".join(problems)

    def refuse_offer(self) -> None:
        """Remove the offer, which was not wanted. Raises OSError."""
        (self.path / OFFER).unlink(missing_ok=True)
        self._tidy()

    def save(self, scenario: Scenario, pinned: tuple[Pinned, ...]) -> None:
        """Replace what was saved of this session. Raises OSError after saving as much as possible."""
        there = (*self._kept, *self._taken_up.runs)
        files = [next((file for known, file in there if known.recording is run.recording), None) for run in pinned]
        if None in files and (self.path / SESSION).exists():  # else the runs of an offer are still in that alone
            # the scenario first, with the runs of before: a long run takes seconds, in which this process may be ended
            with contextlib.suppress(OSError):  # written again below, where it is told
                self._write_index(scenario, self._kept)
        kept, failure = [], None
        for run, file in zip(pinned, files, strict=True):
            try:
                kept.append((run, file or self._write_run(run)))
            except OSError as error:
                failure = error
        self._kept = tuple(kept)  # where the index cannot be written, the next one names the same files
        try:
            self._write_index(scenario, kept)
            if self._taken_up.in_session(scenario, pinned):  # the loop takes it some periods after it has been read
                (self.path / OFFER).unlink(missing_ok=True)
                self._taken_up = _TakenUp()
        finally:
            self._tidy()
        if failure is not None:
            raise failure

    def _write_index(self, scenario: Scenario, kept: Sequence[tuple[Pinned, str]]) -> None:
        """Write the index of the scenario and these runs, each with its file. Raises OSError."""
        runs = [SavedRun(run.number, run.t, file, run.name) for run, file in kept]
        text = msgspec.json.format(msgspec.json.encode(Index(time.time(), to_toml(scenario), runs)))
        write_whole(self.path / SESSION, lambda file: file.write(text), _PRIVATE)
        self._indexed = {run.file for run in runs}

    def _write_run(self, run: Pinned) -> str:
        name = f"run-{uuid.uuid4().hex}.npz"
        # not compressed: that would take cores from the loop for seconds
        data = table(run.scenario, run.recording)
        write_whole(self.path / name, lambda file: write_npz(data, file, level=0), _PRIVATE)
        return name

    def _readable(self, name: str) -> Index | None:
        """Index in a file, None where there is none; a file that is no index is set aside, with a sentence."""
        path = self.path / name
        try:
            return _read(path)
        except FileNotFoundError:
            return None
        except (StateError, ScenarioError) as error:
            aside = path.with_name(ASIDE + name)
            path.replace(aside)
            self.problem = f"the last session cannot be continued: {error}; it is kept as {aside}"
            log.warning("state set aside", file=str(aside), reason=str(error))
            return None

    def _set_aside(self, run: SavedRun) -> None:
        with contextlib.suppress(OSError, StateError):
            path = self._run_file(run)
            path.replace(path.with_name(ASIDE + path.name))

    def _run_file(self, run: SavedRun) -> Path:
        if not _RUN_FILE.fullmatch(run.file):
            raise StateError(f"{run.file[:60]!r} is no name of a run's file")
        return self.path / run.file

    def _tidy(self) -> None:
        """Remove runs that no index names any more, set aside or not. The index of this process is not read: it stays
        whatever is in it."""
        named = {name for _, name in self._kept} | self._indexed
        if (offer := self._readable(OFFER)) is not None:
            named |= {run.file for run in offer.pinned}
        runs = [file for file in self.path.iterdir() if _RUN_FILE.fullmatch(file.name)]
        for name in (SESSION, OFFER):  # now, since a file may have been set aside just before
            named |= _named_aside(self.path / (ASIDE + name), runs)
        for file in (run for run in runs if run.name not in named):
            file.unlink(missing_ok=True)


class Autosave:
    """Autosave of scenario and pinned runs as they change, in a thread of its own. The state at the beginning of a run
    is no change.

    complain: called with a sentence when saving fails, once until it succeeds again.
    begun: the run has begun before, so that its state is saved at once.
    """

    def __init__(
        self, folder: StateFolder, look: Callable[[], Snapshot], complain: Callable[[str], None], *, begun: bool = False
    ) -> None:
        self._folder, self._look, self._complain = folder, look, complain
        self._seen = _subject(look())
        self._saved: _Subject | None = None if begun else self._seen
        self._since = 0.0
        self._complained: float | None = None  # s, monotonic: of a failure to save, None since the last success
        self._closing = threading.Event()
        self._using = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="state", daemon=True)
        self._thread.start()

    def take_up(self, offer: Offer) -> tuple[tuple[Pinned, ...], str]:
        """Pinned runs of an offer that is restored, and a sentence; see `StateFolder.read_offer`."""
        with self._using:
            return self._folder.read_offer(offer)

    def refuse_offer(self) -> None:
        """Remove the offer; see `StateFolder.refuse_offer`."""
        with self._using:
            self._folder.refuse_offer()

    def close(self) -> None:
        """Save what has not been saved yet, and leave the folder."""
        self._closing.set()
        self._thread.join()
        if self._complained is not None:  # there may be room on the disk again
            self._saved = None
        self._keep(_subject(self._look()))
        self._folder.close()

    def _run(self) -> None:
        while not self._closing.wait(EVERY):
            now = _subject(self._look())
            rests, late = _same(now, self._seen), time.monotonic() - self._since > LATEST
            if _same(now, self._saved):
                self._since = time.monotonic()
            elif rests or late:
                self._keep(now)
            self._seen = now

    def _keep(self, subject: _Subject) -> None:
        if _same(subject, self._saved):
            return
        try:
            with self._using:
                self._folder.save(*subject)
        except Exception as error:
            full = isinstance(error, OSError)
            reason = error.strerror if full else f"{type(error).__name__}: {error}"
            log.warning("session not saved", reason=reason, exc_info=None if full else error)
            if self._complained is None or time.monotonic() - self._complained > REMINDER:
                self._complained = time.monotonic()
                self._complain(f"the session cannot be saved in {self._folder.path}: {reason}; the run goes on")
        else:
            self._complained = None
            log.debug("session saved", scenario=subject[0].name, pinned=len(subject[1]))
        # a failure is tried again at the next change
        self._saved, self._since = subject, time.monotonic()


_Subject = tuple[Scenario, tuple[Pinned, ...]]


def default_folder() -> Path:
    """Default state folder: `$XDG_STATE_HOME/vsmrc-lab`, by default below ~/.local/state."""
    return base_directory("XDG_STATE_HOME")


def _subject(snapshot: Snapshot) -> _Subject:
    return snapshot.own_push.restored_in(snapshot.latest.scenario), snapshot.pinned


def _same(subject: _Subject, other: _Subject | None) -> bool:
    if other is None:
        return False
    runs, others = subject[1], other[1]
    same_runs = len(runs) == len(others) and all(a is b for a, b in zip(runs, others, strict=True))
    return same_runs and subject[0] == other[0]


def _read(path: Path) -> Index:
    """Index in a file, with a valid scenario. Raises FileNotFoundError, StateError and ScenarioError."""
    index = decoded(path)
    from_toml(index.scenario)
    return index


def _named_aside(aside: Path, runs: Sequence[Path]) -> set[str]:
    """Names of the runs of an index that was set aside; empty without one. For a damaged index: every run that is not
    newer than it, because an index is written after its files."""
    try:
        written = aside.stat().st_mtime
    except FileNotFoundError:
        return set()
    try:
        content = read_regular(aside, LARGEST)  # a larger one is cut, so that it is not whole
        decode_json(content, dict)
    except (OSError, ValueError):
        return {run.name for run in runs if run.stat().st_mtime <= written}
    return set(_RUN_FILE.findall(content.decode()))


def _pinned(saved: SavedRun, path: Path) -> Pinned:
    scenario, recording, _ = read_npz(path)
    loop = ClosedLoop.from_scenario(scenario, history=1, memory=kept_memory())
    if recording.n != loop.system.layout.n or not len(recording):
        raise StateError(f"{path} does not fit its own scenario")
    if not recording.epochs:  # files of earlier versions do not hold the changes during the run
        recording.epochs.extend(replace(epoch, t=recording.first) for epoch in loop.recording.epochs)
    return Pinned(saved.number, loop.system, recording, saved.t, saved.name[:NAME])
