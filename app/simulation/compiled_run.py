"""Compiled run: many control periods of a closed loop in one compiled call, without the interpreter lock.

`CompiledRun.advance` does what `ClosedLoop.step` does, in the same order. Where a period needs the interpreter (the
watch looks at the posture, an alarm), the compiled function returns, and its caller does what `step` does there.
"""

from __future__ import annotations

from typing import get_args

import numpy as np

from app.simulation.alarms import Alarm
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_period import RunData, run_periods
from app.simulation.stations import APART
from environments.integrators import (
    Integrator,
)
from environments.readings_ahead import ReadingsAhead, known
from environments.rigid_surfaces import out_of_reach
from kernels import compiled_for
from kernels.records import Record
from kernels.rigid_body import (
    Motion,
    same_geometry,
)

BATCH = 4096  # periods whose readings are prepared together


def obstacle(loop: ClosedLoop) -> str | None:
    """Why the compiled run cannot take this loop in its present state, None where it can."""
    law = loop.system.controller.law
    reasons = {
        f"controller.law: {law.kind!r} is a law of your own": loop.system.controller.gains.law < 0,
        "the force sensor has a stage that is known to the interpreter only": not known(loop.state.reader),
        "a hand holds the tool": loop.grip is not None,
    }
    return next((reason for reason, holds in reasons.items() if holds), None)


class CompiledRun:
    """Compiled run of a loop; after an edit of the loop another one has to be made.

    Raises ValueError where there is an `obstacle`.
    """

    def __init__(self, loop: ClosedLoop) -> None:
        reason = obstacle(loop)
        if reason is not None:
            raise ValueError(reason)
        system, n = loop.system, loop.system.robot.n
        plant = system.plant
        self._loop, rows = loop, loop.recording.new_rows(1)
        nominal_chain, true_chain = system.nominal.chain, plant.chain
        self._data = Record(
            RunData(
                period_kernels=loop.addresses,
                plant_kernels=plant.addresses,
                known=nominal_chain,
                true=true_chain,
                seen=Motion.zeros(n),
                moved=Motion.zeros(n),
                alike=same_geometry(nominal_chain, true_chain),
                period=loop.period,
                substeps=plant.substeps,
                integrator=get_args(Integrator).index(system.scenario.simulation.integrator),
                springs=plant.kind.springs,
                massive=plant.kind.massive,
                rigid=plant.kind.rigid,
                ideal=loop.ideal,
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
                close=min(APART, system.constants.radius),
                nearest=-1,
                steps=0,
                read=0,
                done=0,
                moving=False,
                unsolved=False,
                astray=False,
                alarms=0,
            )
        )
        self._spare, self._twin = loop.state.evaluation.copy().data.view(np.uint8), loop.state.arm.copy().data
        self._centres, self._stations = system.constants.centres, system.stations.of
        self._run = compiled_for(run_periods, *self._arguments(ReadingsAhead(loop.state.reader, 1)), np.zeros(1), rows)

    def _arguments(self, ahead: ReadingsAhead) -> tuple[np.ndarray, ...]:
        """Arguments of the compiled function but for times and rows."""
        setting, evaluation, arm, workspace = self._loop.kernel_data
        spare = evaluation.view(np.uint8), self._spare, self._twin
        watched, sensor = (self._centres, self._stations), (ahead.sensing, ahead.errors, ahead.line)
        return self._data.data, setting, evaluation, arm, workspace, *spare, *watched, *sensor

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
                uneventful = uneventful or loop.prepare(left)
                self._call(ahead, ahead.periods - left, uneventful if loop.stopped is None else 1)
            except Exception as error:
                loop.take(data.done, Alarm(0))
                found = out_of_reach(float(np.abs(loop.state.arm.views.load.phi).max())) if data.astray else error
                loop.fail("the plant" if data.moving else "the control law", found)
                data.moving = data.astray = False
                return ahead.periods - left + data.done
            left, uneventful = left - data.done, uneventful - data.done
            loop.take(data.done, Alarm(data.alarms))
            if data.unsolved:
                loop.leave_unsolved()
                data.unsolved = False
            if data.nearest >= 0:
                loop.heed_posture(data.nearest)
        return ahead.periods - left

    @property
    def _station(self) -> int:
        """Station where the sampled loops were judged last, -1 where they are to be judged anew wherever the arm is."""
        return self._loop.judged_station

    def _call(self, ahead: ReadingsAhead, read: int, periods: int) -> None:
        """Call the compiled function for at most `periods` periods. read: number of readings of `ahead` that earlier
        calls have used."""
        loop, data = self._loop, self._data.fields
        rows, begun, state = loop.recording.new_rows(periods), loop.state.steps, loop.state
        data.steps, data.read = begun, read
        data.station = self._station
        t = state.epoch.t + np.arange(begun, begun + len(rows)) * loop.period
        self._run(*self._arguments(ahead), t, rows)


class UnjudgedRun(CompiledRun):
    """Compiled run that does not judge the premises that depend on the posture, which takes a third less time. The
    arm's motion is the same to the last bit, unless a broken promise stops the run."""

    def __init__(self, loop: ClosedLoop) -> None:
        super().__init__(loop)
        self._data.fields.close, self._stations = np.inf, np.zeros_like(self._stations)

    @property
    def _station(self) -> int:
        return 0
