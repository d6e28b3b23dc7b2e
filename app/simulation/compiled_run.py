"""Compiled run: many control periods of a closed loop in one compiled call, without the interpreter lock.

`CompiledRun.advance` does what `ClosedLoop.step` does, in the same order. Where a period needs the interpreter (a
posture check finds a new station, or an alarm), the compiled function returns, and its caller does what `step` does
there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from app.simulation.closed_loop import ClosedLoop
from app.simulation.period.alarms import Alarm
from app.simulation.period.compiled_period import INTEGRATOR_NUMBERS, RunData, run_periods
from environments.integrators import INTEGRATORS
from environments.readings_ahead import ReadingsAhead, compilable
from environments.rigid_surfaces import out_of_reach
from kernels import compiled_for
from kernels.records import Record
from kernels.rigid_body import Motion, same_geometry

BATCH = 4096  # periods whose readings are prepared together


def obstacle(loop: ClosedLoop) -> str | None:
    """Reason why the compiled run cannot take this loop in its present state, None where it can."""
    law, integrator = loop.system.controller.law, loop.system.scenario.simulation.integrator
    reasons = {
        f"controller.law: {law.kind!r} is in plain numpy": not law.compiled,
        f"simulation.integrator: {integrator!r} is known to the interpreter only": integrator not in INTEGRATOR_NUMBERS,
        "the force sensor has a stage that is known to the interpreter only": not compilable(loop.state.reader),
        "a hand holds the tool": loop.grip is not None,
    }
    return next((reason for reason, holds in reasons.items() if holds), None)


class PostureChecks(NamedTuple):
    """Posture checks of a compiled run: where the sampled loops need not be judged again.
    close: rad, distance from a centre of Omega within which they were judged at its station.
    stations: (k,), station of each centre.
    judged_station: the station where they were judged last.
    known_until: s, see `PremiseWatch`."""

    close: float
    stations: np.ndarray
    judged_station: Callable[[], int]
    known_until: float

    @classmethod
    def of(cls, loop: ClosedLoop) -> PostureChecks:
        """Checks as `ClosedLoop.step` makes them."""
        watch = loop.premise_watch
        close = min(watch.near, loop.system.constants.radius)
        # the loop's watch can change
        return cls(close, loop.system.stations.of, lambda: loop.premise_watch.judged_station, watch.known_until)


class CompiledRun:
    """Compiled run of a loop; after an edit of the loop another one has to be made.

    Raises ValueError where there is an `obstacle`.
    """

    def __init__(self, loop: ClosedLoop) -> None:
        reason = obstacle(loop)
        if reason is not None:
            raise ValueError(reason)
        system, n = loop.system, loop.system.robot.n
        plant, integrator = system.plant, system.scenario.simulation.integrator
        self._loop, rows = loop, loop.recording.new_rows(1)
        self._checks = PostureChecks.of(loop)
        nominal_chain, true_chain = system.nominal.chain, plant.chain
        self._data = Record(
            RunData(
                period_kernels=loop.controlled_arm.addresses,
                plant_kernels=plant.addresses,
                known=nominal_chain,
                true=true_chain,
                seen=Motion.zeros(n),
                moved=Motion.zeros(n),
                alike=same_geometry(nominal_chain, true_chain),
                period=loop.period,
                substeps=plant.substeps,
                integrator=INTEGRATOR_NUMBERS[integrator],
                midpoint=INTEGRATORS[integrator].midpoint,
                springs=plant.nature.springs,
                massive=plant.nature.massive,
                rigid=plant.nature.rigid,
                ideal=loop.controlled_arm.ideal,
                carrier=system.robot.tool_joint - 1,
                turned=np.zeros((3, 3)),
                push=system.push,
                pushed=np.zeros(n),
                F=np.zeros(6),
                tau=np.zeros(n),
                first=np.zeros(n),
                guess=np.zeros(3),
                change=np.zeros(3),
                error=np.zeros(3),
                before=np.zeros(3),
                inverse=np.zeros((3, 3)),
                station=-1,
                close=self._checks.close,
                known_until=self._checks.known_until,
                nearest=-1,
                steps=0,
                read=0,
                done=0,
                moving=False,
                asking=False,
                unsolved=False,
                astray=False,
                alarms=0,
            )
        )
        self._spare, self._twin = loop.state.evaluation.copy().data.view(np.uint8), loop.state.arm.copy().data
        self._centres = system.constants.centres
        self._run = compiled_for(run_periods, *self._arguments(ReadingsAhead(loop.state.reader, 1)), np.zeros(1), rows)

    def _arguments(self, ahead: ReadingsAhead) -> tuple[np.ndarray, ...]:
        """Arguments of the compiled function but for times and rows."""
        data = self._loop.controlled_arm.kernel_data
        spare = data.evaluation.view(np.uint8), self._spare, self._twin
        centres, sensor = (self._centres, self._checks.stations), (ahead.sensing, ahead.errors, ahead.line)
        return self._data.data, *data[:-1], *data.law, *spare, *centres, *sensor

    def advance(self, periods: int) -> int:
        """Compute `periods` control periods, or fewer when the run stops; an exception in one stops it, as in
        `ClosedLoop.advance`. Returns their number."""
        left = periods
        while left > 0 and self._loop.stopped is None:
            ahead = ReadingsAhead(self._loop.state.reader, min(left, BATCH))
            computed = self._advance(ahead)
            ahead.end(computed)
            left -= computed
        return periods - left

    def _advance(self, ahead: ReadingsAhead) -> int:
        """Compute the periods of these readings, or fewer when the run stops; returns how many were computed."""
        loop, data, left, uneventful = self._loop, self._data.fields, ahead.periods, 0
        while left > 0 and (data.moving or loop.stopped is None):
            data.done = 0
            try:
                uneventful = uneventful or loop.update_before_periods(left)
                self._call(ahead, ahead.periods - left, uneventful if loop.stopped is None else 1)
            except (Exception, SystemExit) as error:  # a law of one's own may also raise the latter
                loop.adopt_periods(data.done, Alarm(0))
                loop.fail("the plant" if data.moving else "the control law", self._explained(error))
                data.moving = data.astray = data.asking = False
                return ahead.periods - left + data.done
            left, uneventful = left - data.done, uneventful - data.done
            loop.adopt_periods(data.done, Alarm(data.alarms))
            if data.unsolved:
                loop.stop_without_force()
                data.unsolved = False
            if data.nearest >= 0:
                self._judge(data.nearest)
        return ahead.periods - left

    def _judge(self, nearest: int) -> None:
        """Judge the posture of the period that is being computed; an exception in this stops the run, as in a step."""
        try:
            self._loop.premise_watch.judge_posture(nearest)
        except Exception as error:
            self._loop.fail("the control law", error)
            self._data.fields.moving = False

    def _explained(self, error: BaseException) -> Exception:
        """Error that the compiled function has raised, with its reason."""
        data, loop = self._data.fields, self._loop
        if data.astray:
            return out_of_reach(float(np.abs(loop.state.arm.views.load.phi).max()))
        if data.asking:
            return loop.controlled_arm.explained(error)
        assert isinstance(error, Exception)
        return error

    def _call(self, ahead: ReadingsAhead, read: int, periods: int) -> None:
        """Call the compiled function for at most `periods` periods. read: number of readings of `ahead` that earlier
        calls have used."""
        loop, data = self._loop, self._data.fields
        rows, begun, state = loop.recording.new_rows(periods), loop.state.steps, loop.state
        data.steps, data.read = begun, read
        data.station = self._checks.judged_station()
        t = state.epoch.t + np.arange(begun, begun + len(rows)) * loop.period
        self._run(*self._arguments(ahead), t, rows)
