"""Measures of a run: numbers that a lesson takes from the run's recording, and its conditions on them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import msgspec
import numpy as np

from app.analysis.metrics import force_error, measure, motion_error, settling_time
from app.lessons.blocks import Condition, Measure
from app.scenario.errors import ScenarioError
from app.simulation.closed_loop import ClosedLoop
from app.simulation.recording import Recording
from app.simulation.system import System
from parameters import allowed

# factor from the SI unit, by unit of a lesson
FACTORS = {
    "": 1.0,
    "1": 1.0,
    "s": 1.0,
    "ms": 1e3,
    "m": 1.0,
    "mm": 1e3,
    "µm": 1e6,
    "m/s": 1.0,
    "mm/s": 1e3,
    "N": 1.0,
    "mN": 1e3,
    "N/s": 1.0,
    "N·m": 1.0,
    "N·m/s": 1.0,
    "rad": 1.0,
    "deg": math.degrees(1.0),
    "%": 100.0,
}
RESOLUTION = 1e-7  # SI units: changes of a signal below this do not count for its settling
DERIVED: dict[str, Callable[[System, Mapping[str, np.ndarray]], np.ndarray]] = {
    "force_error": force_error,
    "path_error": lambda system, record: np.linalg.norm(motion_error(system, record), axis=1),
    "contact_force": lambda _, record: record["multiplier"],
}
DIGITS = 3
OVER_TIME = ("settles", "below")  # statistics that are times
TIMES = ("s", "ms")


@dataclass(frozen=True)
class MeasuredNumber:
    """Measured number with its unit."""

    value: float
    unit: str

    def __str__(self) -> str:
        if not math.isfinite(self.value):
            return "not within the run"
        number = f"{0.0 if abs(self.value) < 1e-9 else self.value:.{DIGITS}g}"
        if "e" in number:
            number = f"{self.value:.0f}" if abs(self.value) >= 1.0 else f"{self.value:.2g}"
        return f"{number.replace('-', '−')} {self.unit if self.unit != '1' else ''}".rstrip()


def factor_of(unit: str) -> float:
    """Factor from the SI unit to this one. Raises ScenarioError."""
    if unit not in FACTORS:
        raise ScenarioError(f"unit: {unit!r:.40}; {allowed(unit, FACTORS)}")
    return FACTORS[unit]


def signal_of(
    system: System, recording: Recording, name: str, t_from: float, t_to: float
) -> tuple[np.ndarray, np.ndarray]:
    """Times (N,) s and values (N,), SI units, of a signal. name: as in `blocks.Measure`. Raises ScenarioError."""
    field, _, index = name.partition(".")
    stretch = recording.stretch(t_from, t_to)
    if field in DERIVED and not index:
        if field != "path_error" and not system.plant.kind.touches and not system.plant.kind.rigid:
            raise ScenarioError(f"signal: {name!r:.40} where nothing is touched; allowed: with a contact")
        return stretch["t"], DERIVED[field](system, stretch)
    if field not in stretch:
        raise ScenarioError(f"signal: {field!r:.40}; {allowed(field, [*DERIVED, *stretch])}")
    values = stretch[field]
    if values.ndim == 1 and not index:
        return stretch["t"], values
    count = 1 if values.ndim == 1 else values.shape[1]
    if not index.isdecimal() or not 1 <= int(index) <= count:
        raise ScenarioError(f"signal: {name!r:.40}; allowed: {field}.1 to {field}.{count}")
    return stretch["t"], values[:, int(index) - 1]


def measured(loop: ClosedLoop, each: Measure) -> MeasuredNumber:
    """Measured number of a run that has ended. Raises ScenarioError."""
    factor = factor_of(each.unit)
    if (each.metric is None) == (each.signal is None):
        raise ScenarioError("measure: allowed: either a signal or a metric")
    if each.metric is None:
        return taken(loop.system, loop.recording, loop.t, each)
    metrics = msgspec.to_builtins(measure(loop))
    if each.metric not in metrics:
        raise ScenarioError(f"metric: {each.metric!r:.40}; {allowed(each.metric, metrics)}")
    value = metrics[each.metric]
    value = max(value, default=0.0) if isinstance(value, list) else value
    if value is not None and not isinstance(value, int | float):
        raise ScenarioError(f"metric: {each.metric!r:.40} is no number")
    return MeasuredNumber(math.inf if value is None else factor * float(value), each.unit)


def taken(system: System, recording: Recording, now: float, each: Measure) -> MeasuredNumber:
    """Measured number of a signal, in a run that goes on. now: time of the run, s. Raises ScenarioError."""
    if each.statistic in OVER_TIME and each.unit not in TIMES:
        raise ScenarioError(f"unit: {each.unit!r:.40} of the statistic {each.statistic}; {allowed(each.unit, TIMES)}")
    factor, half = factor_of(each.unit), 0.5 * system.scenario.controller.period
    end = now if each.end is None else min(each.end, now)
    start = each.start if each.last is None else max(end - each.last, 0.0)
    t, values = signal_of(system, recording, str(each.signal), start - half, end + half)
    if len(t) < 2:
        raise ScenarioError(f"measure of {each.signal}: nothing is recorded from {start:g} s to {end:g} s")
    return MeasuredNumber(factor * _statistic(t, values, each), each.unit)


def _statistic(t: np.ndarray, values: np.ndarray, each: Measure) -> float:
    match each.statistic:
        case "mean":
            return float(values.mean())
        case "largest":
            return float(values.max())
        case "least":
            return float(values.min())
        case "peak":
            return float(np.abs(values).max())
        case "rms":
            return float(np.sqrt(np.mean(values**2)))
        case "last":
            return float(values[-1])
        case "span":
            return float(np.ptp(values))
        case "variation":
            return float(np.abs(np.diff(values)).sum() / (t[-1] - t[0]))
        case "settles":
            return settling_time(t, values, RESOLUTION)
        case "below":
            if each.level is None:
                raise ScenarioError("statistic below: without a level; allowed: with one, in SI units")
            over = np.flatnonzero(np.abs(values) > each.level)
            if not len(over):
                return 0.0
            return math.inf if over[-1] + 1 == len(t) else float(t[over[-1] + 1] - t[0])


def unmet(conditions: Iterable[Condition], known: Mapping[str, MeasuredNumber]) -> list[str]:
    """Sentences on the conditions that do not hold. Raises ScenarioError for a measure that is not known."""
    sentences = []
    for condition in conditions:
        value = _known(condition.measure, known)
        if condition.above is None and condition.below is None:
            raise ScenarioError(f"condition on {condition.measure}: no limit; allowed: above or below")
        for word, limit in (("above", condition.above), ("below", condition.below)):
            if limit is None:
                continue
            bound = condition.times * (_known(limit, known).value if isinstance(limit, str) else float(limit))
            holds = value.value > bound if word == "above" else value.value < bound
            if not holds:
                sentences.append(f"{condition.measure} is {value}; wanted: {word} {MeasuredNumber(bound, value.unit)}")
    return sentences


def _known(name: str, known: Mapping[str, MeasuredNumber]) -> MeasuredNumber:
    if name not in known:
        raise ScenarioError(f"measure {name!r:.40}; {allowed(name, known)}")
    return known[name]
