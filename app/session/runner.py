"""Thread of the loop: pacing, snapshots, and stops on a fault; what commands do is in `commanded_run.py`."""

from __future__ import annotations

import contextlib
import gc
import itertools
import math
import queue
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import structlog

from app.process.free_memory import give_back
from app.process.priority import RealTimePriority
from app.scenario.schema import Scenario
from app.session.commanded_run import CommandedRun
from app.session.commands import Blend, Command, DragTool, Edit, EditModel, FieldEdit, PushNow, Seek, needs_kernels
from app.session.pacing import Pace, PaceMeter, Schedule
from app.session.snapshot import PREPARING, Snapshot, snapshot_of
from app.simulation.closed_loop import ClosedLoop
from app.storage.constants_store import kept_memory
from app.storage.uploaded_urdfs import FileAccess

log = structlog.get_logger()

BATCH = 0.005  # s of wall time whose steps are computed together, unless a hand holds the tool
UNWATCHED = 0.1  # s, the same while nobody has read a snapshot for `FORGOTTEN` s
FORGOTTEN = 1.0
LEAST_REST = 0.0002  # s, the shortest rest of the thread: at high speeds several steps share it, also with a hand
PUBLISH = 1 / 60  # s, between two snapshots that are read; also the longest rest, and the longest batch of steps
UNREAD = 0.25  # s, until a snapshot that nobody has read is replaced
LAG = 0.1  # s of wall time that the loop may fall behind, besides its rest, before simulated time slows
MEASURE = 0.25  # s, between two measurements of the pace, each over the last `WATCHED` s
WATCHED = 2.0
ENDING = 1.0  # s to wait for the end of the thread
SILENCE = 10.0  # s without a round of the loop's thread, after which it counts as hanging
PREPARATION = 600.0  # s, the same while another arm is prepared, whose kernels may have to be compiled


class Runner:
    """Owner of the loop and of its thread. `post` and `snapshot` may be used from any thread; nothing else touches the
    loop.

    access: files that commands may name, None for any.
    posted: number of commands so far.
    """

    def __init__(self, scenario: Scenario, access: FileAccess | None = None) -> None:
        loop = ClosedLoop.from_scenario(scenario, memory=kept_memory())
        loop.step()  # compiles what is not yet in the cache: it must not delay the loop
        loop.reset()
        self._commanded = CommandedRun(loop, access)
        self._commands: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._wake = threading.Event()  # the thread rests no longer
        self._closing = threading.Event()
        self._priority: RealTimePriority | None = None
        self._thread = threading.Thread(target=self._run, name="closed-loop", daemon=True)
        self._executed = 0
        self._posting, self.posted = threading.Lock(), 0
        self._slowed = False
        self.meter = PaceMeter()
        self._pace_now: Pace | None = None
        self._came_round = time.perf_counter()
        self._newest, self._read, self._looked = self._known(snapshot_of(loop)), False, -math.inf

    @property
    def snapshot(self) -> Snapshot:
        """The newest snapshot: not older than `PUBLISH` s while it is read, than `UNREAD` s otherwise."""
        self._read, self._looked = True, time.perf_counter()
        return self._newest

    @property
    def unrefreshed(self) -> Snapshot:
        """The newest snapshot, without asking the loop for a newer one: for readers that only look for changes. It is
        at most `UNREAD` s old while the run goes on, and never older than the last command."""
        return self._newest

    def start(self, priority: RealTimePriority | None = None) -> None:
        """Start running in real time. priority: of the loop's thread, None for the usual one, e.g. where many loops
        share a machine."""
        self._priority = priority
        # the loop's thread must not wait for that of the screen longer than a control period or so
        sys.setswitchinterval(5e-4)
        # a full collection of what is imported and compiled by now, none of it garbage, would hold the loop for 0.2 s
        give_back()
        gc.freeze()
        self._came_round = time.perf_counter()
        self._thread.start()

    @property
    def hang(self) -> str:
        """Sentence that the loop's thread hangs; "" while it lives, or prepares another arm and has said so."""
        silent = time.perf_counter() - self._came_round
        patience = PREPARATION if self._newest.preparing else SILENCE
        if silent < patience or not self._thread.is_alive():
            return ""
        return f"The loop has given no sign of life for {silent:.0f} s: it hangs, or is being compiled"

    def close(self) -> None:
        """End the thread; returns when it has ended, or soon where another arm is being compiled: the thread ends after
        that."""
        self._closing.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(ENDING)

    def post(self, command: Command) -> int:
        """Queue a command; it takes effect between two control periods. Returns its number: see `Snapshot.executed`."""
        with self._posting:
            self.posted = number = self.posted + 1
            self._commands.put(command)
        self._wake.set()
        return number

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                self._pace()
            except Exception as error:  # any exception ends the run, never the thread: commands are still carried out
                self._give_priority_back()
                self._stop("the loop", error)
                self._newest = self._still()
                self._closing.wait(PUBLISH)

    def _stop(self, stage: str, error: Exception) -> None:
        """End the run for an exception outside of its steps; the recording stays."""
        if self._loop.stopped is None:
            self._loop.fail(stage, error)
            self._commanded.note_stop()

    def _pace(self) -> None:
        schedule = self._schedule()
        began = measured = published = schedule.wall
        changed = False
        while not self._closing.is_set():
            self._wake.clear()
            if queued := self._queued():
                self._give_priority_back()
                published, changed = -math.inf, True
                if self._obey(queued):
                    schedule = self._schedule()
                    began = measured = schedule.wall
                    self._pace_now = None
            now = self._came_round = time.perf_counter()
            if self._commanded.going:
                changed = True
                self._advance(schedule, now)
                if self._commanded.end_slow_motion():
                    schedule = self._schedule()
                    began = measured = schedule.wall
                elif schedule.target(now) - self._loop.t - self._commanded.period > self._lag * self._commanded.speed:
                    schedule = self._schedule()
                if now - measured > MEASURE:
                    measured = now
                    requested = self._commanded.speed / self._commanded.period
                    self._note_pace(self.meter.pace(max(began, now - WATCHED), now, requested))
            if changed and now - published > (PUBLISH if self._read else UNREAD):
                published, changed, self._read = now, False, False
                self._newest = self._publish()
            if self._priority and self._keeps_up:
                self._priority.hold()
            else:
                self._give_priority_back()
            self._wake.wait(self._rest(schedule))

    @property
    def _keeps_up(self) -> bool:
        """Whether the loop keeps up with real time and rests between its batches: one that does not would leave nothing
        of a core to threads of lower priority."""
        return self._commanded.going and self._commanded.speed <= 1.0 and not (self._pace_now and self._pace_now.slowed)

    def _give_priority_back(self) -> None:
        """Go on at the usual priority, e.g. for a command, which may compile or read a file."""
        if self._priority:
            self._priority.give_back()

    def _rest(self, schedule: Schedule) -> float:
        """Longest time (s) that the thread may rest if no command comes.

        Steps are computed in batches: to wake for each step at 1 kHz took 18 % of a core, of which the steps were 3.
        A hand on the tool is answered step by step, and a loop that is late does not rest.
        """
        if not self._commanded.going:
            return PUBLISH
        now = time.perf_counter()
        due = schedule.due(self._loop.t + self._commanded.period) - now
        if due < -PUBLISH:
            return LEAST_REST
        if self._forgotten:
            return max(min(due, UNREAD), UNWATCHED)
        return min(max(due, LEAST_REST if self._loop.grip else BATCH), PUBLISH)

    @property
    def _forgotten(self) -> bool:
        """Whether nobody has read a snapshot for a while."""
        return time.perf_counter() - self._looked > FORGOTTEN

    @property
    def _lag(self) -> float:
        """Wall time (s) that the loop may fall behind. Where nobody looks, a long rest is no reason to slow down."""
        return LAG + UNWATCHED if self._forgotten else LAG

    def _note_pace(self, pace: Pace) -> None:
        if pace.slowed and not self._slowed:
            log.info(
                "slow loop", requested=self._commanded.speed, reached=round(pace.achieved * self._commanded.period, 3)
            )
        self._pace_now, self._slowed = pace, pace.slowed

    @property
    def _loop(self) -> ClosedLoop:
        return self._commanded.loop

    def _schedule(self) -> Schedule:
        """Schedule from now on, at the speed asked for."""
        return Schedule(time.perf_counter(), self._loop.t, self._commanded.speed)

    def _advance(self, schedule: Schedule, began: float) -> None:
        """Compute all steps that are due, now or later; a control step is never skipped."""
        commanded, period = self._commanded, self._commanded.period
        target, first, steps, ended = schedule.target(began) + 1e-12, commanded.loop.t + period, 0, began
        while commanded.loop.t + period <= target and commanded.going and ended - began < PUBLISH:
            commanded.step()
            steps += 1
            ended = time.perf_counter()
        if steps:
            self.meter.note(schedule, began, ended, first, commanded.loop.t, steps)

    def _queued(self) -> list[Command]:
        """Commands that have come, taken from the queue."""
        queued: list[Command] = []
        with contextlib.suppress(queue.Empty):
            while True:
                queued.append(self._commands.get_nowait())
        return queued

    def _obey(self, queued: list[Command]) -> bool:
        """Carry out commands; returns whether simulated time must be paced anew.

        After a push, or an edit within a run, it need not: the loop makes up for the time that these took.
        """
        runs, before = self._commanded.runs, None
        for command, following in itertools.zip_longest(queued, queued[1:]):
            if _overtaken(command, following):
                before = command
                continue
            if needs_kernels(command):
                self._newest = replace(self._newest, notice=PREPARING)
            # where the last position is refused, the one before it counts, if it can; what to say is the last refusal
            if not self._commanded.execute(command) and before and self._commanded.execute(before):
                self._commanded.execute(command)
            before = None
        self._executed += len(queued)
        return self._commanded.runs != runs or not all(
            isinstance(command, FieldEdit | Blend | PushNow | DragTool) for command in queued
        )

    def _publish(self) -> Snapshot:
        """Snapshot for the screen; the last one where the loop can no longer give a view of itself."""
        try:
            seen = snapshot_of(self._loop)
        except Exception as error:
            self._stop("the view of the loop", error)
            return self._still()
        # after a divergence there is nothing to draw
        return self._known(seen) if np.isfinite(seen.q).all() and np.isfinite(seen.tool).all() else self._still()

    def _still(self) -> Snapshot:
        """The last picture of the run, with its present time, stop and notice."""
        loop = self._loop
        return self._known(replace(self._newest, t=loop.t, reason=loop.stopped or "", notice=loop.warning or ""))

    def _known(self, seen: Snapshot) -> Snapshot:
        pace = self._pace_now if self._commanded.going else None
        return replace(self._commanded.known(seen), pace=pace, executed=self._executed)


def _overtaken(command: Command, following: Command | None) -> bool:
    """Whether the next command replaces this one: only the last position of a slider or a hand matters."""
    if isinstance(command, Edit) and isinstance(following, Edit):
        return command.path == following.path
    if isinstance(command, EditModel) and isinstance(following, EditModel):
        return all(command.entries[name].keys() <= following.entries.get(name, {}).keys() for name in command.entries)
    return type(command) is type(following) and isinstance(command, DragTool | Seek)
