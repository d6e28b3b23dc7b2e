"""Readings ahead: the stages of the force sensor for many control periods of a compiled run.

The noise, which does not depend on the force, is drawn beforehand from the reader's random streams. `read_force`
calls the kernels of the stages in the order of `ForceReader.read`; what a stage computes is written in
`environments.sensors` only. Afterwards the reader continues as if it had read those forces itself.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np

from environments.sensors import (
    Bias,
    Delay,
    ForceReader,
    LowPass,
    Noise,
    Stage,
    filtered_further,
    place_in_line,
    with_error,
)
from kernels import inline
from kernels.records import Record

COMPILED: tuple[type[Stage], ...] = (Bias, Noise, LowPass, Delay)  # in the order of `read_force`


class Sensing(NamedTuple):
    """Stages of a sensor.
    bias: (6,).
    gain, filters: of the low-pass, whether there is one.
    filtered, begun: its last output (6,), whether there is one.
    late: (6,), readings by which each entry is late.
    held: readings in the line when it was begun."""

    bias: np.ndarray
    gain: float
    filters: bool
    filtered: np.ndarray
    begun: bool
    late: np.ndarray
    held: int


@inline
def read_force(sensing, errors, line, k, force):
    """Compute the reading number k of a wrench (6,), in its place; errors: (N, 6), the noise; line: (held + N, 6),
    readings before the delay."""
    for a in range(6):
        reading = with_error(with_error(force[a], sensing.bias[a]), errors[k, a])
        if sensing.filters:
            previous = sensing.filtered[a] if sensing.begun else reading
            sensing.filtered[a] = reading = filtered_further(sensing.gain, previous, reading)
        line[sensing.held + k, a] = reading
        force[a] = line[place_in_line(sensing.held + k - sensing.late[a]), a]
    sensing.begun = True


class ReadingsAhead:
    """Data for the next readings of a reader whose stages are all `COMPILED`.

    sensing: `Sensing`, (1,). errors, line: see `read_force`; periods: how many readings there are at most.
    """

    def __init__(self, reader: ForceReader, periods: int) -> None:
        self.periods = periods
        self._noise, self._delay = _stage(reader, Noise), _stage(reader, Delay)
        self._low_pass = low_pass = _stage(reader, LowPass)
        bias = _stage(reader, Bias)
        filtered = np.empty((0, 6)) if low_pass is None else low_pass.memory
        held = np.empty((0, 6)) if self._delay is None else self._delay.line
        self._record = Record(
            Sensing(
                bias=np.zeros(6) if bias is None else bias.error,
                gain=1.0 if low_pass is None else low_pass.gain,
                filters=low_pass is not None,
                filtered=filtered[0] if len(filtered) else np.zeros(6),
                begun=len(filtered) > 0,
                late=np.zeros(6, dtype=np.int64) if self._delay is None else self._delay.sensor.lateness,
                held=len(held),
            )
        )
        self.sensing = self._record.data
        # a copy of the stage draws, since the number of readings that will be used is not known yet
        self.errors = np.zeros((periods, 6)) if self._noise is None else self._noise.copy().draw(periods)
        self.line = np.concatenate([held, np.zeros((periods, 6))])

    def end(self, used: int) -> None:
        """Let the reader continue after `used` readings."""
        if used == 0:
            return
        held = self._record.fields.held
        if self._noise is not None:
            self._noise.draw(used)
        if self._low_pass is not None:
            self._low_pass.recall(self._record.fields.filtered[None])
        if self._delay is not None:
            self._delay.extend(self.line[held : held + used])


def compilable(reader: ForceReader) -> bool:
    """Whether all stages of the reader are `COMPILED`, and a reading passes them in that order."""
    stages = [type(stage) for stage in reader.stages]
    return stages == [each for each in COMPILED if each in stages]


S = TypeVar("S", bound=Stage)


def _stage(reader: ForceReader, kind: type[S]) -> S | None:
    return next((stage for stage in reader.stages if type(stage) is kind), None)
