"""Sensor of force and moment: the loop reads wrenches only through its stages, each a class and an entry of
`STAGES`."""

from __future__ import annotations

from collections import deque
from copy import copy, deepcopy
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from msgspec import structs

from kernels import inline
from parameters import Section, Vector3, Widget, decades, field


class Sensor(Section, frozen=True, forbid_unknown_fields=True):
    """The sensor of force and moment; a reading is a wrench (6,), N and N m."""

    noise: Annotated[
        float,
        field(
            "standard deviation per axis",
            "N",
            decades("noise", 0.01, 10, zero=True),
            ge=0,
            le=100,
            title="noise of the sensor",
        ),
    ] = 0.0
    bias: Annotated[Vector3, field("bias", "N", Widget("bias"))] = (0.0, 0.0, 0.0)
    moment_noise: Annotated[
        float,
        field(
            "standard deviation per axis of the moments",
            "N·m",
            decades("moment noise", 1e-3, 1, zero=True),
            ge=0,
            le=10,
        ),
    ] = 0.0
    moment_bias: Annotated[Vector3, field("bias of the moments", "N·m", Widget("moment bias"))] = (0.0, 0.0, 0.0)
    delay: Annotated[
        float,
        field(
            "delay of the forces", "s", decades("delay", 1e-3, 0.1, zero=True), ge=0, le=1, title="delay of the sensor"
        ),
    ] = 0.0
    moment_delay: Annotated[
        float, field("delay of the moments", "s", decades("moment delay", 1e-3, 0.1, zero=True), ge=0, le=1)
    ] = 0.0
    cutoff: Annotated[
        float,
        field("first-order low-pass, 0 for none", "Hz", decades("low-pass", 1, 1000, zero=True), ge=0, le=1e5),
    ] = 0.0
    ideal: Annotated[
        bool,
        field(
            "rigid or heavy surfaces: the loop through the multiplier is solved, not sampled",
            "",
            title="ideal reading of the sensor",
        ),
    ] = False


@dataclass(frozen=True)
class ForceSensor:
    """A sensor in use. period s: time between two readings."""

    settings: Sensor
    period: float

    @property
    def lateness(self) -> np.ndarray:
        """Numbers (6,) of readings by which each entry of the wrench is late."""
        return np.repeat([round(each / self.period) for each in (self.settings.delay, self.settings.moment_delay)], 3)

    @property
    def gain(self) -> float:
        """Gain of the low-pass, by which its output moves to a reading within one period; 1 without one."""
        cutoff = self.settings.cutoff
        return float(1.0 - np.exp(-2 * np.pi * cutoff * self.period)) if cutoff > 0.0 else 1.0

    @property
    def noise_share(self) -> float:
        """Share of the noise's standard deviation that the low-pass leaves."""
        return float(np.sqrt(self.gain / (2.0 - self.gain)))

    @property
    def late(self) -> int:
        """Number of readings by which the latest entry is late."""
        return int(self.lateness.max())

    def steady(self) -> ForceSensor:
        """The sensor without noise and bias: its reading depends on the force alone."""
        none = (0.0, 0.0, 0.0)
        exact = structs.replace(self.settings, noise=0.0, bias=none, moment_noise=0.0, moment_bias=none)
        return ForceSensor(exact, self.period)

    def of_forces(self) -> ForceSensor:
        """The sensor whose moments are not late: its memory is as short as the forces need."""
        return ForceSensor(structs.replace(self.settings, moment_delay=0.0), self.period)

    def prompt(self) -> ForceSensor:
        """The sensor without delay."""
        return ForceSensor(structs.replace(self.settings, delay=0.0, moment_delay=0.0), self.period)


class Stage:
    """A stage of the sensor that readings pass through, with its memory, within one run."""

    def __init__(self, sensor: ForceSensor, seed: int) -> None:
        del seed
        self.sensor = sensor

    @staticmethod
    def acts(sensor: ForceSensor) -> bool:
        """Whether this sensor has the stage."""
        raise NotImplementedError

    def read(self, reading: np.ndarray) -> np.ndarray:
        """Output of the stage for a reading (6,); to be called once per control period."""
        raise NotImplementedError

    @property
    def full(self) -> bool:
        """Whether its memory has its final shape."""
        return True

    @property
    def memory(self) -> np.ndarray:
        """Readings in memory that the next outputs depend on, beside the force, (k, 6)."""
        return np.empty((0, 6))

    def recall(self, memory: np.ndarray) -> None:
        """Continue from another memory of the same shape."""

    def copy(self) -> Stage:
        """Copy of the stage that continues from the same memory."""
        return copy(self)


@inline
def with_error(reading, error):
    """Reading with an error in it: a bias, or noise."""
    return reading + error


class Bias(Stage):
    """A constant error."""

    @staticmethod
    def acts(sensor: ForceSensor) -> bool:
        return any(sensor.settings.bias) or any(sensor.settings.moment_bias)

    def read(self, reading: np.ndarray) -> np.ndarray:
        return with_error.py_func(reading, self.error)

    @property
    def error(self) -> np.ndarray:
        """The constant error (6,)."""
        return np.array([*self.sensor.settings.bias, *self.sensor.settings.moment_bias])


class Noise(Stage):
    """White noise, with two random streams, one for forces and one for moments, so that a change of one noise leaves
    the other one as it is. Its first error is as small as a low-pass leaves it, since a sensor runs long before a run
    begins."""

    def __init__(self, sensor: ForceSensor, seed: int) -> None:
        super().__init__(sensor, seed)
        self._random = np.random.default_rng(seed), np.random.default_rng((seed, 1))
        self._begun = False

    @staticmethod
    def acts(sensor: ForceSensor) -> bool:
        return sensor.settings.noise > 0.0 or sensor.settings.moment_noise > 0.0

    def read(self, reading: np.ndarray) -> np.ndarray:
        return with_error.py_func(reading, self.draw(1)[0])

    def draw(self, readings: int) -> np.ndarray:
        """Errors (N, 6) of the next readings."""
        sizes = self.sensor.settings.noise, self.sensor.settings.moment_noise
        drawn = zip(sizes, self._random, strict=True)
        errors = np.hstack([size * random.standard_normal((readings, 3)) for size, random in drawn])
        if not self._begun:
            errors[:1] *= self.sensor.noise_share
            self._begun = readings > 0
        return errors

    def copy(self) -> Noise:
        twin = copy(self)
        twin._random = deepcopy(self._random)
        return twin


@inline
def filtered_further(gain, previous, reading):
    """Output of a low-pass with this gain for a reading, after the previous output."""
    return previous + gain * (reading - previous)


class LowPass(Stage):
    """A first-order low-pass, initialized by its first reading."""

    def __init__(self, sensor: ForceSensor, seed: int) -> None:
        super().__init__(sensor, seed)
        self.gain = sensor.gain
        self._filtered: np.ndarray | None = None

    @staticmethod
    def acts(sensor: ForceSensor) -> bool:
        return sensor.settings.cutoff > 0.0

    def read(self, reading: np.ndarray) -> np.ndarray:
        previous = reading if self._filtered is None else self._filtered
        self._filtered = filtered = filtered_further.py_func(self.gain, previous, reading)
        return filtered

    @property
    def full(self) -> bool:
        return self._filtered is not None

    @property
    def memory(self) -> np.ndarray:
        return np.empty((0, 6)) if self._filtered is None else self._filtered[None]

    def recall(self, memory: np.ndarray) -> None:
        self._filtered = memory[0].copy()


@inline
def place_in_line(place):
    """Place in a delay line of the reading that leaves it; a line shorter than its delay begins with the oldest one.
    place: of the newest reading less the delay, negative where the line is shorter."""
    return max(0, place)


class Delay(Stage):
    """A delay line of readings, oldest first; forces and moments leave it after delays of their own."""

    def __init__(self, sensor: ForceSensor, seed: int) -> None:
        super().__init__(sensor, seed)
        self._line: deque[np.ndarray] = deque(maxlen=1 + sensor.late)
        self._lateness = sensor.lateness

    @staticmethod
    def acts(sensor: ForceSensor) -> bool:
        return sensor.late > 0

    def read(self, reading: np.ndarray) -> np.ndarray:
        self._line.append(reading.copy())  # the given array may be a live view of the force
        newest = len(self._line) - 1
        forces, moments = (self._line[place_in_line.py_func(newest - self._lateness[a])] for a in (0, 3))
        return np.concatenate([forces[:3], moments[3:]])

    @property
    def full(self) -> bool:
        return len(self._line) == self._line.maxlen

    @property
    def memory(self) -> np.ndarray:
        return np.array(list(self._line)[1:]).reshape(-1, 6)

    def recall(self, memory: np.ndarray) -> None:
        self._line.extend((self._line[0], *memory))

    @property
    def line(self) -> np.ndarray:
        """Readings in the line, (k, 6), oldest first."""
        return np.array(self._line).reshape(-1, 6)

    def extend(self, readings: np.ndarray) -> None:
        """Take up readings (k, 6) that came in order."""
        self._line.extend(reading.copy() for reading in readings[-1 - self.sensor.late :])

    def copy(self) -> Delay:
        twin = copy(self)
        twin._line = self._line.copy()
        return twin


STAGES: tuple[type[Stage], ...] = (Bias, Noise, LowPass, Delay)  # in the order in which a reading passes them


class ForceReader:
    """A sensor within one run: its stages with their memory."""

    def __init__(self, sensor: ForceSensor, seed: int) -> None:
        self._stages = [stage(sensor, seed) for stage in STAGES if stage.acts(sensor)]

    def read(self, force: np.ndarray) -> np.ndarray:
        """Reading of the sensor (6,) for the true wrench (6,); to be called once per control period."""
        for stage in self._stages:
            force = stage.read(force)
        return force

    @property
    def stages(self) -> tuple[Stage, ...]:
        """Stages of the sensor, in the order in which a reading passes them."""
        return tuple(self._stages)

    @property
    def full(self) -> bool:
        """Whether the memory of every stage has its final shape."""
        return all(stage.full for stage in self._stages)

    @property
    def memory(self) -> np.ndarray:
        """Readings in memory that the next reading depends on, beside the force: (k, 6), stage by stage."""
        return np.concatenate([np.empty((0, 6)), *(stage.memory for stage in self._stages)])

    def recall(self, memory: np.ndarray) -> None:
        """Continue from another memory of the same shape."""
        for stage in self._stages:
            own = len(stage.memory)
            if own:
                stage.recall(memory[:own])
            memory = memory[own:]

    def copy(self) -> ForceReader:
        """Copy of the reader that continues from the same memory."""
        twin = copy(self)
        twin._stages = [stage.copy() for stage in self._stages]
        return twin
