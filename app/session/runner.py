"""Thread of the loop: pacing, commands, snapshots, and stops on a fault."""

from __future__ import annotations

import contextlib
import gc
import itertools
import math
import queue
import sys
import threading
import time
from dataclasses import dataclass, replace

import numpy as np
import structlog

from app.process.free_memory import give_back
from app.scenario.data import edited, with_values
from app.scenario.schema import Scenario, ScenarioError
from app.session import changes
from app.session.commands import (
    Blend,
    Command,
    Continue,
    DropWayOut,
    Edit,
    EditAll,
    Fork,
    Load,
    Pause,
    Perform,
    Pin,
    Play,
    Push,
    PushNow,
    Rename,
    Reset,
    Seek,
    SetSpeed,
    ShowAgain,
    StepOnce,
    TakeWayOut,
    TimedChange,
    ToEnd,
    Unpin,
)
from app.session.nearest_model import way_to_model
from app.session.pacing import Pace, PaceMeter, Schedule
from app.session.snapshot import PREPARING, Snapshot, snapshot_of
from app.session.timeline import Timeline
from app.simulation.closed_loop import ClosedLoop
from app.storage.constants_store import kept_memory
from app.storage.uploaded_urdfs import Reach, hold

log = structlog.get_logger()

BATCH = 0.01  # s of wall time whose steps are computed together, unless a hand holds the tool
UNWATCHED = 0.1  # s, the same while nobody has read a snapshot for `FORGOTTEN` s
FORGOTTEN = 1.0
LEAST_REST = 0.0002  # s, the shortest rest of the thread: at high speeds several steps share it, also with a hand
PUBLISH = 1 / 60  # s, between two snapshots that are read; also the longest rest, and the longest batch of steps
UNREAD = 0.25  # s, until a snapshot that nobody has read is replaced
LAG = 0.1  # s of wall time that the loop may fall behind, besides its rest, before simulated time slows
MEASURE = 0.25  # s, between two measurements of the pace, each over the last `WATCHED` s
WATCHED = 2.0
ENDING = 1.0  # s to wait for the end of the thread
SILENCE = 10.0  # s without a round of the thread: it hangs
SLOWEST, FASTEST = 0.01, 100.0


@dataclass(frozen=True)
class _Stretch:
    """Stretch of a run that is shown at a speed of its own, see `ShowAgain`.
    run: number of the run.
    end: s, its last instant.
    usual: the speed afterwards."""

    run: int
    end: float
    usual: float


@dataclass(frozen=True)
class _Performance:
    """Performance: a run with changes at fixed instants, see `Perform`.
    run: number of the run.
    changes: those that are still to come.
    end: s, the last instant."""

    run: int
    changes: tuple[TimedChange, ...]
    end: float


class Runner:
    """Owner of the loop and of its thread. `post` and `snapshot` may be used from any thread; nothing else touches the
    loop.

    reach: files that commands may name, None for any.
    posted: number of commands so far.
    """

    def __init__(self, scenario: Scenario, reach: Reach | None = None) -> None:
        loop = ClosedLoop(scenario, memory=kept_memory())
        loop.step()  # compiles what is not yet in the cache: it must not delay the loop
        loop.reset()
        self._line = Timeline(loop)
        hold(loop.system.robot, scenario.robot.urdf)
        self._commands: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._wake = threading.Event()  # the thread rests no longer
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="closed-loop", daemon=True)
        self._reach = reach
        self._playing = True
        self._speed = 1.0
        self._shown: _Stretch | None = None
        self._performed: _Performance | None = None
        self._revision = self._runs = self._refusals = self._heard = 0
        self._posting, self.posted = threading.Lock(), 0
        self._refusal: str | None = None
        self._told = ""
        self._way_out: changes.WayOut | None = None
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
    def latest(self) -> Snapshot:
        """The newest snapshot for readers who need none that is younger than `UNREAD` s, such as those that look for
        changes: it is never older than the last command, and reading it asks for no other."""
        return self._newest

    def start(self) -> None:
        """Start running in real time."""
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
        if silent < SILENCE or not self._thread.is_alive() or self._newest.notice == PREPARING:
            return ""
        return f"The loop has given no sign of life for {silent:.0f} s: it hangs, or is being compiled"

    def close(self) -> None:
        """End the thread; returns when it has ended, or soon where another arm is being compiled: the thread ends after
        that."""
        self._closing.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(ENDING)

    def post(self, command: Command) -> None:
        """Queue a command; it takes effect between two control periods."""
        with self._posting:
            self.posted += 1
            self._commands.put(command)
        self._wake.set()

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                self._pace()
            except Exception as error:  # any exception ends the run, never the thread: commands are still carried out
                self._stop("the loop", error)
                self._newest = self._still()
                self._closing.wait(PUBLISH)

    def _stop(self, stage: str, error: Exception) -> None:
        """End the run for an exception outside of its steps; the recording stays."""
        if self._loop.stopped is None:
            self._loop.fail(stage, error)
            self._note_stop()

    def _pace(self) -> None:
        schedule = self._schedule()
        began = measured = published = schedule.wall
        changed = False
        while not self._closing.is_set():
            self._wake.clear()
            if queued := self._queued():
                published, changed = -math.inf, True
                if self._obey(queued):
                    schedule = self._schedule()
                    began = measured = schedule.wall
                    self._pace_now = None
            now = self._came_round = time.perf_counter()
            if self._going:
                changed = True
                self._advance(schedule, now)
                if self._resumes():
                    schedule = self._schedule()
                    began = measured = schedule.wall
                elif schedule.target(now) - self._loop.t - self._period > self._lag * self._speed:
                    schedule = self._schedule()
                if now - measured > MEASURE:
                    measured = now
                    asked = self._speed / self._period
                    self._note_pace(self.meter.pace(max(began, now - WATCHED), now, asked))
            if changed and now - published > (PUBLISH if self._read else UNREAD):
                published, changed, self._read = now, False, False
                self._newest = self._publish()
            self._wake.wait(self._rest(schedule))

    def _rest(self, schedule: Schedule) -> float:
        """Longest time (s) that the thread may rest if no command comes.

        Steps are computed in batches: to wake for each step at 1 kHz took 18 % of a core, of which the steps were 3.
        A hand on the tool is answered step by step, and a loop that is late does not rest.
        """
        if not self._going:
            return PUBLISH
        now = time.perf_counter()
        due = schedule.due(self._loop.t + self._period) - now
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

    def _resumes(self) -> bool:
        """Whether the stretch that is shown at a speed of its own is over just now, at its end or because another run
        has begun; then the former speed holds."""
        shown = self._shown
        if shown is None or (shown.run == self._runs and self._loop.t < shown.end):
            return False
        self._speed, self._shown = shown.usual, None
        return True

    def _note_stop(self) -> None:
        log.info("stopped", scenario=self._loop.system.scenario.name, reason=self._loop.stopped)

    def _note_pace(self, pace: Pace) -> None:
        if pace.slowed and not self._slowed:
            log.info("slow loop", asked=self._speed, reached=round(pace.achieved * self._period, 3))
        self._pace_now, self._slowed = pace, pace.slowed

    @property
    def _loop(self) -> ClosedLoop:
        return self._line.loop

    @property
    def _going(self) -> bool:
        return self._playing and self._loop.stopped is None

    @property
    def _period(self) -> float:
        return self._loop.period

    def _schedule(self) -> Schedule:
        """Schedule from now on, at the speed asked for."""
        return Schedule(time.perf_counter(), self._loop.t, self._speed)

    def _advance(self, schedule: Schedule, began: float) -> None:
        """Compute all steps that are due, now or later; a control step is never skipped."""
        line, period = self._line, self._period
        target, first, steps, ended = schedule.target(began) + 1e-12, line.loop.t + period, 0, began
        while line.loop.t + period <= target and self._going and ended - began < PUBLISH:
            self._step()
            steps += 1
            ended = time.perf_counter()
        if steps:
            self.meter.note(schedule, began, ended, first, line.loop.t, steps)

    def _step(self) -> None:
        """Compute one control period; the end of a blend changes the scenario."""
        self._perform()
        blending, stopped = self._loop.system.blend is not None, self._loop.stopped
        self._line.step()
        if self._loop.stopped is not stopped:
            self._note_stop()
        if blending and self._loop.system.blend is None:
            self._revision += 1

    def _perform(self) -> None:
        """Make the changes of a performance that are due, and pause where the next period is its last one. The
        performance is over when another run has begun; while looking back, no change is due."""
        performed, line = self._performed, self._line
        if performed is None or line.loop.t < line.end - 0.5 * self._period:
            return
        if performed.run != self._runs:
            self._performed = None
            return
        while performed.changes and performed.changes[0].due(line.loop.t, self._period):
            change, *rest = performed.changes
            self._performed = performed = replace(performed, changes=tuple(rest))
            command = Edit(change.path, change.value)
            try:
                self._heed(command)
            except ScenarioError as error:
                self._refuse(str(error), command)
        if line.loop.t > performed.end - 1.5 * self._period:
            self._playing, self._performed = False, None

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
        runs = self._runs
        for command, following in itertools.zip_longest(queued, queued[1:]):
            if _overtaken(command, following):
                continue
            if isinstance(command, Load | Continue | Perform) or (
                isinstance(command, Edit) and command.path.startswith(("mode", "robot."))
            ):
                self._newest = replace(self._newest, notice=PREPARING)
            try:
                self._heed(command)
            except (ScenarioError, ArithmeticError, ValueError) as error:
                self._refuse(str(error), command)
            except Exception as error:  # a fault of this program: the command has failed, and the run goes on
                log.error("fault", stage="a command", command=type(command).__name__, exc_info=error)
                self._refuse(f"{type(command).__name__} failed ({type(error).__name__}: {error})", command)
        self._heard += len(queued)
        return self._runs != runs or not all(
            isinstance(command, Edit | EditAll | Blend | PushNow | Push) for command in queued
        )

    def _require_reach(self, command: Command) -> None:
        """Raises ScenarioError for a file that this loop's pages may not name."""
        match command:
            case Load(scenario) | Perform(scenario) if self._reach is not None:
                self._reach.require(scenario.robot.urdf)
            case Edit("robot.urdf", path) if self._reach is not None:
                self._reach.require(path)
            case _:
                pass

    def _refuse(self, sentence: str, command: Command) -> None:
        self._refusal = sentence
        self._refusals += 1
        log.info("refused", command=type(command).__name__, sentence=sentence)

    def _heed(self, command: Command) -> None:
        """Carry out a command; where it is refused, note the way out, if there is one."""
        way = self._way_out
        match command:
            case TakeWayOut() if way is not None and way.scenario is not None:
                self._adapt(way.scenario, way.scenario)
            case TakeWayOut() if way is not None and way.fork_at is not None:
                self._way_out = None  # also where that instant is no longer known
                self._carry_out(Seek(way.fork_at))
                self._carry_out(Fork())
            case DropWayOut():
                self._way_out = None
            case TakeWayOut():
                raise ScenarioError("way out: there is none; allowed: after a refusal that names one")
            case Fork():
                self._way_out = None
                try:
                    self._carry_out(command)
                except ScenarioError:
                    self._way_out = self._earlier_fork()
                    raise
            case Edit(path, value):
                self._way_out = None
                try:
                    self._carry_out(command)
                except ScenarioError:
                    self._way_out = self._way_out or changes.nearest(self._loop.system.scenario, path, value)
                    raise
            case _:
                self._carry_out(command)

    def _earlier_fork(self) -> changes.WayOut | None:
        """Way out of a refused fork at the run's end: a fork at the last change, or at the earliest known instant."""
        t, first = self._line.last_change, self._line.first
        if t is None:
            return None
        return changes.WayOut(f"Fork at the {'last change' if t > first else 'earliest instant'}, {t:.2f} s", fork_at=t)

    def _carry_out(self, command: Command) -> None:
        line, scenario_now = self._line, self._loop.system.scenario
        self._require_reach(command)
        match command:
            case Play():
                self._playing = True
            case Pause():
                self._playing = False
                line.hold(None)
            case StepOnce():
                self._playing = False
                self._step()
            case Reset():
                line.reset()
                self._runs += 1
                if self._way_out is not None and self._way_out.fork_at is not None:  # an instant of the run before
                    self._way_out = None
            case Seek(t):
                line.hold(None)
                line.seek(t)
                self._playing = False
            case ToEnd():
                line.to_end()
            case Fork():
                line.fork()
                self._runs += 1
            case Pin():
                line.pin()
            case Rename(number, name):
                line.rename(number, name)
            case Unpin(number):
                line.unpin(number)
            case SetSpeed(factor):
                self._speed, self._shown = _admitted(factor), None
            case ShowAgain(start, end, factor):
                slow, usual = _admitted(factor), self._speed if self._shown is None else self._shown.usual
                line.hold(None)
                line.seek(start)
                self._speed, self._shown, self._playing = slow, _Stretch(self._runs, end, usual), True
            case Push(grip):
                line.hold(grip)
            case Blend(model, over):
                plan = {"to": dict(model), "at": line.loop.t, "over": over}
                self._edit(edited(scenario_now, "blend", plan))
            case Load(scenario):
                self._edit(scenario)
            case EditAll(values):
                self._edit(with_values(scenario_now, dict(values)))
            case Perform(scenario, changes_to_come, end):
                self._edit(scenario)
                line.reset()
                self._runs += 1
                self._performed, self._playing = _Performance(self._runs, changes_to_come, end), True
            case Continue(scenario, pinned):
                self._edit(scenario)
                line.adopt(pinned)
            case PushNow():
                self._edit(changes.pushed(scenario_now, line.loop.t))
            case Edit("mode", value) if value == scenario_now.mode:
                pass  # the present mode is not begun anew
            case Edit("mode", value):
                self._adapt(scenario_now, changes.in_mode(scenario_now, str(value)))
            case Edit(path, value) if path.startswith("robot."):
                self._adapt(scenario_now, changes.with_robot(scenario_now, {path.removeprefix("robot."): value}))
            case Edit("task_space.kind" | "task_space.supplemental" as path, value):
                asked = edited(scenario_now, path, value)
                self._adapt(asked, changes.in_coordinates(scenario_now, path.removeprefix("task_space."), value))
            case Edit("surface" | "second.surface" | "third.surface" as path, str() as kind):
                changed = changes.on_surface(scenario_now, kind, path)
                self._adapt(changed, changed)
            case Edit("second.contact.kind" | "third.contact.kind" as path, str() as kind):
                self._edit(changes.with_further(scenario_now, path.split(".")[0], kind))
            case Edit("face.flat", bool() as flat):
                self._adapt(edited(scenario_now, "face.flat", flat), changes.with_face(scenario_now, flat=flat))
            case Edit("second.control" | "third.control" as path, value):
                self._edit(changes.with_control(scenario_now, path, value))
            case Edit(path, value):
                self._edit(edited(scenario_now, path, value))

    def _adapt(self, asked: Scenario, scenario: Scenario) -> None:
        """Edit to the nearest scenario that can run, and say how it differs from what was asked."""
        changes.possible(scenario, self._edit)
        self._told = changes.told(asked, self._loop.system.scenario)

    def _edit(self, scenario: Scenario) -> None:
        before = self._loop.system.robot
        try:
            self._runs += self._line.edit(scenario)
        except ScenarioError as error:
            self._way_out = changes.way_out(scenario, error) or way_to_model(self._loop.system, scenario)
            raise
        self._way_out = None
        if self._loop.system.robot is not before:
            hold(self._loop.system.robot, scenario.robot.urdf)
        self._told = ""
        self._revision += 1

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
        line, loop = self._line, self._loop
        return replace(
            seen,
            notice=seen.notice or self._told,
            revision=self._revision,
            run=self._runs,
            first=line.first,
            end=line.end,
            phase="stopped" if loop.stopped else "running" if self._playing else "paused",
            pace=self._pace_now if self._going else None,
            speed=self._speed,
            refusal=self._refusal,
            refusal_number=self._refusals,
            heard=self._heard,
            way_out=self._way_out,
            recording=line.recording,
            pinned=line.pinned,
            forks=line.forks,
        )


def _admitted(speed: float) -> float:
    """The speed, if it is one that the runner keeps. Raises ScenarioError."""
    if not SLOWEST <= speed <= FASTEST:
        raise ScenarioError(f"speed: {speed}; allowed: {SLOWEST} to {FASTEST}")
    return float(speed)


def _overtaken(command: Command, following: Command | None) -> bool:
    """Whether the next command replaces this one: only the last position of a slider or a hand matters."""
    if isinstance(command, Edit) and isinstance(following, Edit):
        return command.path == following.path
    return type(command) is type(following) and isinstance(command, Push | Seek)
