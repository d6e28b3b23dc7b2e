"""Run under commands: what each command changes, what is refused and why, and the way out of a refusal."""

from __future__ import annotations

from dataclasses import dataclass, replace

import structlog

from app.scenario.data import edited, from_plain, to_plain, with_values
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session import changes
from app.session.adaptation_sentence import adaptation_sentence
from app.session.commands import (
    BeginScenario,
    Blend,
    Command,
    Continue,
    DragTool,
    DropWayOut,
    Edit,
    EditAll,
    EditModel,
    Fork,
    Load,
    Pause,
    Perform,
    Pin,
    Play,
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
from app.session.field_edits import PlannedEdit, planned_edit
from app.session.model_entries import with_model_entries
from app.session.nearest_model import way_to_model
from app.session.own_push import OwnPush
from app.session.snapshot import Snapshot
from app.session.timeline import Timeline
from app.session.ways_out import WayOut, nearest, way_out
from app.simulation.builders.restarts import begins_anew
from app.simulation.closed_loop import ClosedLoop
from app.storage.uploaded_urdfs import FileAccess, lock_while_used

log = structlog.get_logger()

SLOWEST, FASTEST = 0.01, 100.0


@dataclass(frozen=True)
class _SlowMotion:
    """Slow motion: a stretch of a run at a speed of its own, see `ShowAgain`.
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


class CommandedRun:
    """Run under commands, without pacing: its timeline, whether it plays and how fast, and what was refused.

    access: files that commands may name, None for any.
    timeline: of the runs.
    playing: whether it is to go on.
    speed: simulated over real time.
    runs: number of runs so far, revision: number of edits so far.
    """

    def __init__(self, loop: ClosedLoop, access: FileAccess | None) -> None:
        self.timeline = Timeline(loop)
        lock_while_used(loop.system.robot, loop.system.scenario.robot.urdf)
        self._access = access
        self.playing, self.speed = True, 1.0
        self._slow_motion: _SlowMotion | None = None
        self._performed: _Performance | None = None
        self.revision = self.runs = 0
        self._refusals, self._adaptation = 0, ""
        self._refusal: str | None = None
        self._way_out: WayOut | None = None
        self._own_push = OwnPush()

    @property
    def loop(self) -> ClosedLoop:
        """The loop of the present run."""
        return self.timeline.loop

    @property
    def going(self) -> bool:
        """Whether it plays and has not stopped."""
        return self.playing and self.loop.stopped is None

    @property
    def period(self) -> float:
        """Control period, s."""
        return self.loop.period

    def execute(self, command: Command) -> bool:
        """Carry out a command; one that cannot be carried out is refused, and the run goes on. Returns whether it was
        carried out."""
        before, way = self._refusals, self._way_out
        try:
            self._dispatch(command)
        except (ScenarioError, ArithmeticError, ValueError) as error:
            self._refuse(str(error), command, way)
        except Exception as error:  # a fault of this program: the command has failed, and the run goes on
            log.error("fault", stage="a command", command=type(command).__name__, exc_info=error)
            self._refuse(f"{type(command).__name__} failed ({type(error).__name__}: {error})", command, way)
        return self._refusals == before

    def step(self) -> None:
        """Compute one control period; the end of a blend changes the scenario."""
        self._perform()
        blending, stopped = self.loop.system.blend is not None, self.loop.stopped
        self.timeline.step()
        if self.loop.stopped is not stopped:
            self.note_stop()
        if blending and self.loop.system.blend is None:
            self._way_out = None  # made of the scenario with the blend
            self.revision += 1

    def _perform(self) -> None:
        """Make the changes of a performance that are due, and pause where the next period is its last one. The
        performance is over when another run has begun; while looking back, no change is due."""
        performed, timeline = self._performed, self.timeline
        if performed is None or timeline.loop.t < timeline.end - 0.5 * self.period:
            return
        if performed.run != self.runs:
            self._performed = None
            return
        while performed.changes and performed.changes[0].due(timeline.loop.t, self.period):
            change, *rest = performed.changes
            self._performed = performed = replace(performed, changes=tuple(rest))
            self.execute(Edit(change.path, change.value))
        if timeline.loop.t > performed.end - 1.5 * self.period:
            self.playing, self._performed = False, None

    def end_slow_motion(self) -> bool:
        """End a slow motion that is over, by its end or because another run has begun, and restore the speed. Returns
        whether it did."""
        slow = self._slow_motion
        if slow is None or (slow.run == self.runs and self.loop.t < slow.end):
            return False
        self.speed, self._slow_motion = slow.usual, None
        return True

    def note_stop(self) -> None:
        """Log that the run has stopped."""
        log.info("stopped", scenario=self.loop.system.scenario.name, reason=self.loop.stopped)

    def _require_access(self, command: Command) -> None:
        """Raises ScenarioError for a file that this loop's pages may not name."""
        match command:
            case Load(scenario) | BeginScenario(scenario) | Perform(scenario) if self._access is not None:
                self._access.require(scenario.robot.urdf)
            case Edit("robot.urdf", path) if self._access is not None:
                self._access.require(path)
            case _:
                pass

    def _refuse(self, sentence: str, command: Command, way: WayOut | None) -> None:
        """Refuse a command. way: out of an earlier refusal, which is no way out of this one; a refused look back leaves
        it, as it has nothing to do with the scenario."""
        if self._way_out is way and not isinstance(command, Seek):
            self._way_out = None
        self._refusal = sentence
        self._refusals += 1
        log.info("refused", command=type(command).__name__, sentence=sentence)

    def _dispatch(self, command: Command) -> None:
        """Carry out a command; where it is refused, note the way out, if there is one."""
        way = self._way_out
        match command:
            case TakeWayOut() if way is not None and way.scenario is not None:
                self._edit_as_planned(PlannedEdit(way.scenario, requested=way.scenario, nearest=True))
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
                    self._way_out = self._way_out or nearest(self.loop.system.scenario, path, value)
                    raise
            case Seek() | ToEnd() | ShowAgain():
                self._carry_out(command)
                self._way_out = None  # made of the scenario at another instant
            case _:
                self._carry_out(command)

    def _earlier_fork(self) -> WayOut | None:
        """Way out of a refused fork at the run's end: a fork at the last change, or at the earliest known instant."""
        t, first = self.timeline.last_change, self.timeline.first
        if t is None:
            return None
        return WayOut(f"Fork at the {'last change' if t > first else 'earliest instant'}, {t:.2f} s", fork_at=t)

    def _carry_out(self, command: Command) -> None:
        self._require_access(command)
        match command:
            case Play() | Pause() | StepOnce() | Reset() | Seek() | ToEnd() | SetSpeed() | ShowAgain():
                self._move_in_time(command)
            case Fork():
                self.timeline.fork()
                self.runs += 1
            case Pin(may_be_pinned):
                self.timeline.pin(may_be_pinned=may_be_pinned)
            case Rename(number, name):
                self.timeline.rename(number, name)
            case Unpin(number):
                self.timeline.unpin(number)
            case DragTool(grip):
                self.timeline.drag_tool(grip)
            case _:
                self._change_scenario(command)

    def _move_in_time(self, command: Command) -> None:
        """Carry out a command on playing, its speed, or the instant that is shown."""
        timeline = self.timeline
        match command:
            case Play():
                self.playing = True
            case Pause():
                self.playing = False
                timeline.drag_tool(None)
            case StepOnce():
                self.playing = False
                self.step()
            case Reset():
                self._reset()
            case Seek(t):
                timeline.require_known(t)
                timeline.drag_tool(None)
                timeline.seek(t)
                self.playing = False
            case ToEnd():
                timeline.to_end()
            case SetSpeed(factor):
                self.speed, self._slow_motion = _admitted(factor), None
            case ShowAgain(start, end, factor):
                slow, usual = _admitted(factor), self.speed if self._slow_motion is None else self._slow_motion.usual
                timeline.require_known(start)
                timeline.drag_tool(None)
                timeline.seek(start)
                self.speed, self._slow_motion, self.playing = slow, _SlowMotion(self.runs, end, usual), True

    def _change_scenario(self, command: Command) -> None:
        """Carry out a command that gives the run another scenario."""
        timeline, scenario_now = self.timeline, self.loop.system.scenario
        match command:
            case Blend(model, over):
                plan = {"to": dict(model), "at": self._now, "over": over}
                self._edit(edited(scenario_now, "blend", plan))
            case Load(scenario):
                self._edit(scenario, as_it_is=True)
            case EditAll(values):
                self._edit(with_values(scenario_now, dict(values)))
            case EditModel(entries):
                self._edit(with_model_entries(scenario_now, entries))
            case BeginScenario(scenario):
                self._begin(scenario)
            case Perform(scenario, changes_to_come, end):
                self._begin(scenario)
                self._performed = _Performance(self.runs, changes_to_come, end)
            case Continue(scenario, pinned):
                self._edit(scenario, as_it_is=True)
                timeline.adopt(pinned)
            case PushNow():
                own = self._own_push
                self._edit(changes.pushed(scenario_now, timeline.loop.system.robot, self._now), as_it_is=True)
                self._own_push = own.after_button(scenario_now, timeline.loop.system.scenario)
            case Edit():
                planned = planned_edit(command, scenario_now)
                if planned is not None:
                    self._edit_as_planned(planned)

    @property
    def _now(self) -> float:
        """Instant at which an edit takes effect, s: 0 where the run has stopped, since it then begins anew."""
        return 0.0 if self.loop.stopped else self.loop.t

    def _edit_as_planned(self, planned: PlannedEdit) -> None:
        """Edit to a scenario, and say how the one that runs differs from what was asked for."""
        if planned.nearest:
            changes.possible(planned.scenario, self._edit)
        else:
            self._edit(planned.scenario)
        if planned.requested is not None:
            running = self.loop.system
            self._adaptation = adaptation_sentence(planned.requested, running.scenario, running.units)

    def _edit(self, scenario: Scenario, *, as_it_is: bool = False) -> None:
        """Edit to this scenario; where that begins a new run, with its own push, unless it is to be taken as it is."""
        before = self.loop.system.robot
        over = self.loop.stopped is not None or begins_anew(self.loop.system.scenario, scenario)
        if over and not as_it_is:
            scenario = self._own_push.restored_in(scenario)
        try:
            # a change may have converted a number, or taken one of the run, beyond what a scenario's file may have
            if self.timeline.edit(from_plain(to_plain(scenario))):
                self.runs += 1
        except ScenarioError as error:
            self._way_out = way_out(scenario, error) or way_to_model(self.loop.system, scenario)
            raise
        self._way_out = None
        if over or as_it_is:
            self._own_push = OwnPush()
        if self.loop.system.robot is not before:
            lock_while_used(self.loop.system.robot, scenario.robot.urdf)
        self._adaptation = ""
        self.revision += 1

    def _begin(self, scenario: Scenario) -> None:
        """Begin this scenario at t = 0, also where an edit would let the run go on, and let it run."""
        self._edit(scenario, as_it_is=True)
        self._reset()
        self.playing = True

    def _reset(self) -> None:
        """Begin the run's scenario at t = 0, with its own push."""
        self.timeline.reset()
        self.runs += 1
        if self._way_out is not None and self._way_out.fork_at is not None:  # an instant of the run before
            self._way_out = None
        own, self._own_push = self._own_push.restored_in(self.timeline.latest.scenario), OwnPush()
        if own != self.timeline.latest.scenario:
            self._way_out = None  # made of the scenario with that push
            self.timeline.edit(own)
            self.timeline.reset()  # the run is that of its scenario, without an edit at t = 0
            self.revision += 1

    def known(self, seen: Snapshot) -> Snapshot:
        """The snapshot of the loop with what is known of its run."""
        timeline, loop = self.timeline, self.loop
        return replace(
            seen,
            notice=seen.notice or self._adaptation,
            revision=self.revision,
            run=self.runs,
            first=timeline.first,
            end=timeline.end,
            stop=timeline.stop,
            performing=self._performed is not None and self._performed.run == self.runs and not loop.stopped,
            phase="stopped" if loop.stopped else "running" if self.playing else "paused",
            speed=self.speed,
            refusal=self._refusal,
            refusal_number=self._refusals,
            way_out=self._way_out,
            own_push=self._own_push,
            latest=timeline.latest,
            recording=timeline.recording,
            pinned=timeline.pinned,
            forks=timeline.forks,
        )


def _admitted(speed: float) -> float:
    """The speed, if it is one that the runner keeps. Raises ScenarioError."""
    if not SLOWEST <= speed <= FASTEST:
        raise ScenarioError(f"speed: {speed}; allowed: {SLOWEST} to {FASTEST}")
    return float(speed)
