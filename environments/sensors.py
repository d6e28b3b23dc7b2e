"""The force sensor: the loop reads forces only through its stages, each a class and a row of `STAGES`."""

from __future__ import annotations

from collections import deque
from copy import copy, deepcopy
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from msgspec import structs

from parameters import Section, Vector3, Widget, decades, field


class Sensor(Section, frozen=True, forbid_unknown_fields=True):
    """The force sensor."""

    noise: Annotated[
        float, field("standard deviation per axis", "N", decades("noise", 0.01, 10, zero=True), ge=0, le=100)
    ] = 0.0
    bias: Annotated[Vector3, field("bias", "N", Widget("bias"))] = (0.0, 0.0, 0.0)
    delay: Annotated[float, field("delay", "s", decades("delay", 1e-3, 0.1, zero=True), ge=0, le=1)] = 0.0
    cutoff: Annotated[
        float,
        field("first-order low-pass, 0 for none", "Hz", decades("low-pass", 1, 1000, zero=True), ge=0, le=1e5),
    ] = 0.0
    ideal: Annotated[
        bool, field("rigid or heavy surfaces: the loop through the multiplier is solved, not sampled", "")
    ] = False


@dataclass(frozen=True)
class ForceSensor:
    """A sensor in use. period s: time between two readings."""

    settings: Sensor
    period: float

    @property
    def late(self) -> int:
        """By how many readings it is late."""
        return round(self.settings.delay / self.period)

    def steady(self) -> ForceSensor:
        """Without noise and bias: what is left depends on the force alone."""
        return ForceSensor(structs.replace(self.settings, noise=0.0, bias=(0.0, 0.0, 0.0)), self.period)


class Stage:
    """What a reading goes through within one run, with its memory."""

    def __init__(self, sensor: ForceSensor, seed: int) -> None:
        del seed
        self.sensor = sensor

    @staticmethod
    def acts(sensor: ForceSensor) -> bool:
        """Whether this sensor has it."""
        raise NotImplementedError

    def read(self, reading: np.ndarray) -> np.ndarray:
        """What becomes of a reading (3,) N; called once per control period."""
        raise NotImplementedError

    @property
    def full(self) -> bool:
        """Whether its memory has the shape that it keeps."""
        return True

    @property
    def memory(self) -> np.ndarray:
        """What the next readings are made of beside the force, (k, 3) N."""
        return np.empty((0, 3))

    def recall(self, memory: np.ndarray) -> None:
        """Go on from another memory of the same shape."""

    def copy(self) -> Stage:
        """A stage that goes on from the same memory."""
        return copy(self)


class Bias(Stage):
    """A constant error."""

    @staticmethod
    def acts(sensor: ForceSensor) -> bool:
        return any(sensor.settings.bias)

    def read(self, reading: np.ndarray) -> np.ndarray:
        return reading + np.array(self.sensor.settings.bias)


class Noise(Stage):
    """White noise, with its random stream."""

    def __init__(self, sensor: ForceSensor, seed: int) -> None:
        super().__init__(sensor, seed)
        self._random = np.random.default_rng(seed)

    @staticmethod
    def acts(sensor: ForceSensor) -> bool:
        return sensor.settings.noise > 0.0

    def read(self, reading: np.ndarray) -> np.ndarray:
        return reading + self.sensor.settings.noise * self._random.standard_normal(3)

    def copy(self) -> Noise:
        twin = copy(self)
        twin._random = deepcopy(self._random)
        return twin


class LowPass(Stage):
    """A first-order low-pass, which begins at its first reading."""

    def __init__(self, sensor: ForceSensor, seed: int) -> None:
        super().__init__(sensor, seed)
        self._gain = 1.0 - np.exp(-2 * np.pi * sensor.settings.cutoff * sensor.period)
        self._filtered: np.ndarray | None = None

    @staticmethod
    def acts(sensor: ForceSensor) -> bool:
        return sensor.settings.cutoff > 0.0

    def read(self, reading: np.ndarray) -> np.ndarray:
        previous = reading if self._filtered is None else self._filtered
        self._filtered = filtered = previous + self._gain * (reading - previous)
        return filtered

    @property
    def full(self) -> bool:
        return self._filtered is not None

    @property
    def memory(self) -> np.ndarray:
        return np.empty((0, 3)) if self._filtered is None else self._filtered[None]

    def recall(self, memory: np.ndarray) -> None:
        self._filtered = memory[0]


class Delay(Stage):
    """A line of readings under way, oldest first, the one that came out last at its head."""

    def __init__(self, sensor: ForceSensor, seed: int) -> None:
        super().__init__(sensor, seed)
        self._line: deque[np.ndarray] = deque(maxlen=1 + sensor.late)

    @staticmethod
    def acts(sensor: ForceSensor) -> bool:
        return sensor.late > 0

    def read(self, reading: np.ndarray) -> np.ndarray:
        self._line.append(reading.copy())  # the force that is given may be that of now, whenever it is looked at
        return self._line[0]

    @property
    def full(self) -> bool:
        return len(self._line) == self._line.maxlen

    @property
    def memory(self) -> np.ndarray:
        return np.array(list(self._line)[1:]).reshape(-1, 3)

    def recall(self, memory: np.ndarray) -> None:
        self._line.extend((self._line[0], *memory))

    def copy(self) -> Delay:
        twin = copy(self)
        twin._line = self._line.copy()
        return twin


STAGES: tuple[type[Stage], ...] = (Bias, Noise, LowPass, Delay)  # in the order in which a reading goes through them


class ForceReader:
    """A sensor within one run: its stages with what they remember."""

    def __init__(self, sensor: ForceSensor, seed: int) -> None:
        self._stages = [stage(sensor, seed) for stage in STAGES if stage.acts(sensor)]

    def read(self, force: np.ndarray) -> np.ndarray:
        """What the sensor shows (3,) N for the true force (3,) N; call once per control period."""
        for stage in self._stages:
            force = stage.read(force)
        return force

    @property
    def full(self) -> bool:
        """Whether every reading under way has been taken."""
        return all(stage.full for stage in self._stages)

    @property
    def memory(self) -> np.ndarray:
        """What the next readings are made of, beside the force: (k, 3) N, stage by stage."""
        return np.concatenate([np.empty((0, 3)), *(stage.memory for stage in self._stages)])

    def recall(self, memory: np.ndarray) -> None:
        """Go on from another memory of the same shape."""
        for stage in self._stages:
            own = len(stage.memory)
            if own:
                stage.recall(memory[:own])
            memory = memory[own:]

    def copy(self) -> ForceReader:
        """A reader that goes on from the same memory."""
        twin = copy(self)
        twin._stages = [stage.copy() for stage in self._stages]
        return twin
