"""Preview (what if): the next seconds of a run under an edited scenario, from its present state; no thread, no screen,
no file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

import msgspec
import numpy as np

from app.analysis.metrics import (
    FORCE_RESOLUTION,
    MOTION_RESOLUTION,
    MULTIPLIERS,
    after_positions,
    angle_error,
    force_error,
    force_settling_time,
    motion_error,
    settling_time,
    tail_of,
)
from app.analysis.steady_force import steady_force_error
from app.scenario.departures import undrawn
from app.scenario.schema import Scenario, TruthSection
from app.session.arm_band import BandStretch
from app.session.changes import sideways
from app.session.preview_messages import Preview, PreviewMetrics, PreviewRefusal, PreviewRequest
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun, obstacle
from app.simulation.engines import Engine
from app.simulation.omega.search_memory import Memory
from app.simulation.state import State
from app.simulation.system import System

POINTS = 200  # about the number of pixels that a plot has ahead of now
STEADY = 1e-6  # N, by which a desired force may vary in the tail and still count as constant
STILL = 1e-6  # m, the same of a distance that is followed
BEGINS, LASTS = 0.1, 1.0  # s after now, and s, of the push on an arm that nothing else would move
GROWTH = 0.02  # share by which an error has to differ from another one to count as another
SAME = 1e-4  # rad or m of a joint, within which a run is where it was foreseen; the two engines differ far less
LOOKS = 50  # instants at which the reference is compared with the present one


class PreviewRun:
    """Run of a preview: it answers a request, piece by piece.

    previous: a system whose equal parts are used again; memory: results of searches.
    engine: "compiled" is used only where it can take the scenario; without its kernels in the cache it takes seconds.
    restarts: whether the edit begins the scenario anew.

    Raises ScenarioError when the edited scenario cannot be built.
    """

    def __init__(
        self,
        request: PreviewRequest,
        previous: System | None = None,
        memory: Memory | None = None,
        engine: Engine = "pinocchio",
    ) -> None:
        self.request = request
        rows = max(1, round(request.horizon / request.scenario.controller.period))
        self._loop = ClosedLoop.from_state(request.state, 2 * rows, previous, memory)
        self.base = self._loop.system  # of the running scenario: a good `previous` for the next request
        if request.scenario != request.state.scenario:
            self._loop.edit(request.scenario)
        self.restarts = self._loop.t != request.state.t
        self._push = request.push if request.push and self._rests() else 0.0
        if self._push:
            self._loop.edit(_pushed(self._loop.system, self._loop.t + BEGINS, self._push))
        self._start, self._rows, self._points = self._loop.t, rows, _points(rows)
        self._first = 0  # row with which the horizon begins
        self._metrics_from_first: PreviewMetrics | None = None  # see `metrics_from`; a paused loop asks again and again
        self._obstacle = (
            obstacle(self._loop) if engine == "compiled" else "it appears once this arm and contact are compiled"
        )
        self._run = CompiledRun(self._loop) if self._obstacle is None else None
        self.stretch = BandStretch.beyond(request.state.t, self._loop.state.copy(), rows, self._points)

    @property
    def bandless(self) -> str:
        """Reason why no band of true arms can be computed for this request, "" where one can."""
        if self._obstacle is not None:
            return self._obstacle
        return undrawn(self._loop.system.scenario.declared)

    @cached_property
    def unchanged(self) -> PreviewRequest:
        """Request about the scenario that runs, without the edit, for the same seconds: from the run's beginning where
        the edit begins it anew. With a push where the asked one has a push."""
        state = ClosedLoop.from_system(self.base.anew(), history=1).state if self.restarts else self.request.state
        return replace(self.request, state=state, scenario=state.scenario, push=self._push)

    @property
    def progress(self) -> float:
        """Share of the horizon that is computed, 0 to 1; 1 for a run that has stopped."""
        return 1.0 if self._loop.stopped else (len(self._loop.recording) - self._first) / self._rows

    def leads_to(self, state: State) -> bool:
        """Whether the run has come to this state as it was foreseen: without an edit, a hand, or a push in between, and
        not in another run of the scenario. A push that only this preview has does not move the arm: it still rests."""
        began, row = self.request.state, self._row_of(state)
        if (state.grip, state.epoch.t) != (began.grip, began.epoch.t) or not 0 <= row < len(self._loop.recording):
            return False
        there = began.arm.views.q if self._push else self._loop.recording.picked(np.array([row]), ("q",))["q"][0]
        return bool(np.abs(state.arm.views.q - there).max() < SAME)

    def metrics_from(self, state: State) -> PreviewMetrics | None:
        """Metrics over one horizon that begins at `state`, through which this run passes (see `leads_to`). They begin
        at the first row where nothing is computed yet, or where the preview has a push. Missing periods are computed.
        None where the state is more than a horizon after the request, or the run stopped before it."""
        recording = self._loop.recording
        row = self._row_of(state) if len(recording) and not self._push else 0
        if row > self._rows:
            return None
        if row != self._first or self._metrics_from_first is None:
            self._first = row
            while self.progress < 1.0:
                self.advance(self.batch)
            points = self._points[self._points < len(recording) - row] + row
            if not len(points):
                return None
            begin = self._start + (row - 0.5) * self.request.scenario.controller.period
            stretch = recording.stretch(begin, begin + self._rows * self.request.scenario.controller.period)
            self._metrics_from_first = self._metrics(stretch, recording.picked(points))
        return self._metrics_from_first

    def _row_of(self, state: State) -> int:
        """Number of the row at the instant of a state."""
        return round((state.t - self.request.state.t) / self.request.scenario.controller.period)

    def _rests(self) -> bool:
        """Whether nothing moves the arm within the horizon: no reference, surface, push or disturbance."""
        loop, scenario, horizon = self._loop, self._loop.system.scenario, self.request.horizon
        truth, began = scenario.truth, scenario.truth.push_start
        comes = (any(truth.push) or any(truth.push_moment)) and began < loop.t + horizon
        if comes and (truth.push_every > 0.0 or began + truth.push_duration > loop.t):
            return False
        moving = any(each.form.motion.amplitude > 0.0 or each.form.changing for each in scenario.surfaces)
        if truth.disturbance > 0.0 or moving:
            return False
        now = self.base.reference(loop.t)  # an edit may move the reference, too
        later = [loop.system.reference(t) for t in loop.t + np.linspace(0.0, horizon, LOOKS)]
        moved = max(float(np.abs(reference.r_d - now.r_d).max()) for reference in later)
        changed = max(float(np.abs(reference.F_cd - now.F_cd).max()) for reference in later)
        return moved < MOTION_RESOLUTION and changed < FORCE_RESOLUTION

    @property
    def batch(self) -> int:
        """Number of control periods that take about a millisecond."""
        return 25 if self._run is None else 250

    def advance(self, steps: int) -> None:
        """Compute that many control periods, or up to the horizon."""
        loop, left = self._loop, min(steps, self._first + self._rows - len(self._loop.recording))
        if self._run is not None:
            self._run.advance(left)
        else:
            for _ in range(left):
                loop.advance()

    def preview(self, today: PreviewMetrics | None = None) -> Preview | PreviewRefusal:
        """Preview of what has been computed so far. today: metrics of the running scenario."""
        number, recording = self.request.number, self._loop.recording
        points = self._points[self._points < len(recording)]
        if not len(points):  # also where the run has stopped in its first period, which is not drawn
            return PreviewRefusal(
                number, f"nothing lies ahead: {self._loop.stopped or 'no control period is computed yet'}"
            )
        signals = recording.picked(points)
        return Preview(
            number,
            self.request.scenario,
            self._start,
            signals,
            tuple(recording.epochs),
            self._metrics(recording.stretch(), signals),
            whole=self.progress >= 1.0,
            restarts=self.restarts,
            today=today,
            bandless=self.bandless if self.request.arms else "",
        )

    def _metrics(self, record: Mapping[str, np.ndarray], thinned: dict[str, np.ndarray]) -> PreviewMetrics:
        loop, system, t = self._loop, self._loop.system, record["t"]
        tail, robust = tail_of(t), system.controller.law.robust
        deviations, behind = _path_error(system, thinned), tail_of(thinned["t"])
        path = np.linalg.norm(deviations, axis=1) if deviations.shape[1] else None
        angles = angle_error(system, thinned) if _turns(system) else None
        error = predicted = settling = overshoot = path_settling = pressing = pressed = None
        stopped = self._loop.stopped is not None
        if system.m:
            deviation, f_nd = force_error(system, record), record["F_cd"][tail]
            error = float(deviation[tail].mean())
            if np.ptp(f_nd, axis=0).max() < STEADY and not _moves_faces(system, record["r_d"][tail]):
                s = record["s"][tail].mean(axis=0)
                predicted = steady_force_error(system, record["r_d"][-1], f_nd[-1], s)
            settling = np.inf if stopped else force_settling_time(system, record)
            overshoot = _beyond(deviation, error)
        if path is not None:
            path_settling = np.inf if stopped else settling_time(thinned["t"], path, MOTION_RESOLUTION)
        if system.plant.nature.touches:
            force = np.linalg.norm([record[name] for name in MULTIPLIERS[: len(system.surfaces)]], axis=0)
            pressing, pressed = float(force.max()), None if system.m else float(force[tail].mean())
        return PreviewMetrics(
            span=float(t[-1] - t[0]) + system.scenario.controller.period,
            push=self._push,
            force_error=error,
            force_error_predicted=predicted,
            force_settling=settling,
            force_overshoot=overshoot,
            contact_largest=pressing,
            contact_final=pressed,
            motion_largest=None if path is None else float(path.max()),
            motion_grows=path is not None and _grows(path, behind),
            motion_error=None if path is None else float(path[behind].max()),
            motion_settling=path_settling,
            motion_overshoot=_other_side(deviations) if self._push and path is not None else None,
            angle_largest=None if angles is None else float(angles.max()),
            angle_error=None if angles is None else float(angles[behind].max()),
            torque_largest=float(np.abs(record["tau_applied"]).max()),
            reaching_time=(np.inf if loop.reaching_time is None else loop.reaching_time) if robust else None,
            reaching_time_promised=None if loop.state.epoch.band_reached_by is None else loop.certificate.t_r,
            gain_margin=float((record["d"] - record["d_required"]).min()) if robust else None,
            left=loop.stopped or loop.warning or _unpromised(loop),
        )


def _pushed(system: System, t: float, newtons: float) -> Scenario:
    """The scenario with one push, sideways and within the plane of a planar arm, from t (s) on."""
    push, scenario = sideways(system.robot, newtons), system.scenario
    truth = TruthSection(push=push, push_start=t, push_duration=LASTS)
    once = {name: getattr(truth, name) for name in truth.__struct_fields__ if name.startswith("push")}
    return msgspec.structs.replace(scenario, truth=msgspec.structs.replace(scenario.truth, **once))


def _moves_faces(system: System, r_d: np.ndarray) -> bool:
    """Whether the tool moves followed faces of a body that it presses. r_d: (N, n)."""
    return bool(system.plan.followed.sets and np.ptp(r_d[:, system.m : len(system.surfaces)], axis=0).max() > STILL)


def _turns(system: System) -> bool:
    """Whether the angles yield to a moment or follow a path."""
    first = system.layout.end_of_positions
    yields = (system.controller.model.K_f[first:] * system.controller.controlled).any()
    return bool(yields) or system.scenario.rotation.moves


def _grows(path: np.ndarray, tail: np.ndarray) -> bool:
    """Whether the last of these errors (N,) is about the largest one, after a tail in which they have grown."""
    return bool(path[-1] > (1.0 - GROWTH) * path.max() and path[-1] > (1.0 + GROWTH) * path[tail][0])


def _beyond(signal: np.ndarray, final: float) -> float:
    """Overshoot of a force (N,) N: largest way beyond its final value, seen from its beginning; to either side where it
    begins at that value."""
    over, under = float((signal - final).max()), float((final - signal).max())
    way = final - float(signal[0])
    if abs(way) < FORCE_RESOLUTION:  # the sign of a residue says nothing
        return max(over, under)
    return max(over if way > 0.0 else under, 0.0)


def _other_side(errors: np.ndarray) -> float:
    """Overshoot of errors (N, k): largest way to the side opposite of the largest error, after it."""
    top = int(np.linalg.norm(errors, axis=1).argmax())
    size = float(np.linalg.norm(errors[top]))
    return max(float((-errors[top:] @ errors[top]).max()) / size, 0.0) if size > 0.0 else 0.0


def _unpromised(loop: ClosedLoop) -> str | None:
    """Reason why nothing is promised at the end; None where something is."""
    promise = loop.standing.now
    return None if promise.verdict == "holds" else f"{promise.verdict}: {promise.because}"


def _path_error(system: System, record: dict[str, np.ndarray]) -> np.ndarray:
    """Position errors (N, k) m as plots show them: where no force is controlled, also those into a surface."""
    if system.m or system.layout.joint:
        return motion_error(system, record)
    return record["e_r"][:, [*range(system.layout.positions), *after_positions(system, angles=False)]]


def _points(rows: int) -> np.ndarray:
    """Indices of the drawn ones among `rows` rows: half of the points evenly spaced, half closer and closer towards
    now, where the response to an edit is fast. The first row is left out: there `controller.on_change` may make s
    exactly 0, which no logarithmic axis can show."""
    if rows < 3:
        return np.arange(rows)
    even, close = np.linspace(1, rows - 1, POINTS // 2), np.geomspace(1, rows - 1, POINTS // 2)
    return np.unique(np.concatenate([even, close]).astype(int))
