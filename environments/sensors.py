"""The force sensor: bias, noise, low-pass, delay. The loop reads forces only through it."""

from __future__ import annotations

from collections import deque
from copy import copy, deepcopy
from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True)
class ForceSensor:
    """noise: standard deviation per axis, N; bias (3,) N; delay s; cutoff of a first-order low-pass, Hz, 0 for none;
    period s: time between two readings."""

    noise: float
    bias: np.ndarray
    delay: float
    cutoff: float
    period: float

    @cached_property
    def exact(self) -> bool:
        """Whether it shows the force as it is."""
        return self.noise == 0.0 and self.delay == 0.0 and self.cutoff == 0.0 and not self.bias.any()


class ForceReader:
    """The sensor's memory within one run: its random stream, the filter and the delay line."""

    def __init__(self, sensor: ForceSensor, seed: int) -> None:
        self.sensor = sensor
        self._random = np.random.default_rng(seed)
        self._filtered: np.ndarray | None = None
        self._line: deque[np.ndarray] = deque(maxlen=1 + round(sensor.delay / sensor.period))

    def read(self, force: np.ndarray) -> np.ndarray:
        """What the sensor shows (3,) N for the true force (3,) N; call once per control period."""
        sensor = self.sensor
        if sensor.exact:
            return force
        reading = force + sensor.bias
        if sensor.noise > 0.0:
            reading = reading + sensor.noise * self._random.standard_normal(3)
        if sensor.cutoff > 0.0:
            gain = 1.0 - np.exp(-2 * np.pi * sensor.cutoff * sensor.period)
            previous = reading if self._filtered is None else self._filtered
            reading = self._filtered = previous + gain * (reading - previous)
        self._line.append(reading)
        return self._line[0]

    @property
    def full(self) -> bool:
        """Whether every reading under way has been taken."""
        return self.sensor.exact or len(self._line) == self._line.maxlen

    @property
    def memory(self) -> np.ndarray:
        """What the next readings are made of, beside the force: the filter's value, if it has one, and the readings
        under way, oldest first; (k, 3) N."""
        filtered = [] if self._filtered is None else [self._filtered]
        return np.array([*filtered, *list(self._line)[1:]]).reshape(-1, 3)

    def recall(self, memory: np.ndarray) -> None:
        """Go on from another memory of the same shape."""
        first = self._filtered is not None
        if first:
            self._filtered = memory[0]
        if self._line:
            self._line.extend((self._line[0], *memory[int(first) :]))

    def copy(self) -> ForceReader:
        """A reader that goes on from the same memory; no reading is ever changed in place."""
        twin = copy(self)
        twin._random, twin._line = deepcopy(self._random), self._line.copy()
        return twin
