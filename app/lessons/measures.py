"""Measures of a run: numbers that a lesson takes from the run's recording, and its conditions on them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import msgspec
import numpy as np

from app.analysis.metrics import Metrics, force_error, metrics_of, path_error, settling_time
from app.lessons.blocks import Condition, Measure
from app.lessons.words import ENGLISH, words_of
from app.scenario.errors import ScenarioError
from app.scenario.field_info import infos_of
from app.scenario.number_text import short, without_rounding
from app.simulation.closed_loop import ClosedLoop
from app.simulation.recording import Recording
from app.simulation.signals import SIGNALS
from app.simulation.system import System
from parameters import allowed

# SI unit of each unit of a lesson, and the factor from it
UNITS = {
    "": ("1", 1.0),
    "1": ("1", 1.0),
    "%": ("1", 100.0),
    "s": ("s", 1.0),
    "ms": ("s", 1e3),
    "m": ("m", 1.0),
    "mm": ("m", 1e3),
    "µm": ("m", 1e6),
    "m/s": ("m/s", 1.0),
    "mm/s": ("m/s", 1e3),
    "m/s^2": ("m/s^2", 1.0),
    "N": ("N", 1.0),
    "mN": ("N", 1e3),
    "N/s": ("N/s", 1.0),
    "N·m": ("N·m", 1.0),
    "N·m/s": ("N·m/s", 1.0),
    "rad": ("rad", 1.0),
    "mrad": ("rad", 1e3),
    "deg": ("rad", math.degrees(1.0)),
    "rad/s": ("rad/s", 1.0),
    "mrad/s": ("rad/s", 1e3),
    "rad/s^2": ("rad/s^2", 1.0),
    "J": ("J", 1.0),
}
PER_SECOND = {"m/s": "m/s^2", "rad/s": "rad/s^2"}  # SI units of changes per second; others have "/s" behind them
RESOLUTION = 1e-7  # SI units: changes of a signal below this do not count for its settling
DERIVED = ("force_error", "path_error", "contact_force")  # signals that are computed from the recorded ones
RECORDED = {signal.name: signal for signal in SIGNALS}
METRICS = infos_of(Metrics)
HAPPENING = ("settling_time", "reaching_time", "band_time")  # metrics that are None while it has not happened
DIGITS = 3  # of a number, those that are shown
OVER_TIME = ("settles", "below")  # statistics that are times


@dataclass(frozen=True)
class MeasuredNumber:
    """Measured number with its unit."""

    value: float
    unit: str

    def __str__(self) -> str:
        return self.text(ENGLISH.language)

    def text(self, language: str) -> str:
        """Number and unit as the texts of a lesson in this language write them."""
        words = words_of(language)
        if not math.isfinite(self.value):
            return words.never
        number = words.number(short(without_rounding(self.value), DIGITS))
        return f"{number} {self.unit if self.unit != '1' else ''}".rstrip()


@dataclass(frozen=True)
class Unmet:
    """Condition that does not hold: the name of its measure, the measured number, and the limit.
    wanted: above or below."""

    measure: str
    value: MeasuredNumber
    wanted: str
    limit: MeasuredNumber

    def __str__(self) -> str:
        return f"{self.measure} is {self.value}; wanted: {self.wanted} {self.limit}"


def factor_of(unit: str) -> float:
    """Factor from the SI unit to this one. Raises ScenarioError."""
    if unit not in UNITS:
        raise ScenarioError(f"unit: {unit!r:.40}; {allowed(unit, filter(None, UNITS))}")
    return UNITS[unit][1]


def factor_for(unit: str, si: str, of: str) -> float:
    """Factor to a unit in which numbers with this SI unit can be told. of: whose unit it is. Raises ScenarioError."""
    factor = factor_of(unit)
    if UNITS[unit][0] != si:
        fitting = [each for each, (base, _) in UNITS.items() if base == si and each]
        if not fitting:
            raise ScenarioError(f"unit: {unit!r:.40} of {of}, whose numbers are {si}; allowed: a signal of one unit")
        raise ScenarioError(f"unit: {unit!r:.40} of {of}; {allowed(unit, fitting)}")
    return factor


def si_unit_of(system: System, name: str) -> str:
    """SI unit of a signal. name: as in `blocks.Measure`, of a signal that there is."""
    if name in DERIVED and name != "path_error":
        return "N"
    if name == "path_error":
        return RECORDED["e_r"].unit_in(system.units)
    field, _, index = name.partition(".")
    return RECORDED[field].units_in(system.units, system.robot.slides)[int(index or 1) - 1]


def signal_of(system: System, record: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    """Values (N,), SI units, of a signal in recorded rows, at least two. name: as in `blocks.Measure`. Raises
    ScenarioError for a signal that the run does not have."""
    values = _derived(system, record, name) if name in DERIVED else _recorded(record, name)
    if not np.isfinite(values).any():  # as the bound (20) under a law without one
        raise ScenarioError(f"signal: {name!r:.40}, which has no value in this run; allowed: one that the run has")
    return values


def _derived(system: System, record: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    if name == "path_error":
        if (error := path_error(system, record)) is None:
            raise ScenarioError(f"signal: {name!r} where every position is pressed; allowed: where one is free")
        return error
    if not system.plant.nature.touches and not system.plant.nature.rigid:
        raise ScenarioError(f"signal: {name!r} where nothing is touched; allowed: with a contact")
    if name == "contact_force":
        return record["multiplier"]
    if not system.pressed:
        raise ScenarioError(
            f"signal: {name!r} in {system.scenario.mode} mode, which controls no force; "
            "allowed: contact_force, or a mode that controls a force"
        )
    return force_error(system, record)


def _recorded(record: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    field, _, index = name.partition(".")
    if field not in record:
        raise ScenarioError(f"signal: {field!r:.40}; {allowed(field, [*DERIVED, *record])}")
    values = record[field]
    if values.ndim == 1 and not index:
        return values
    count = 1 if values.ndim == 1 else values.shape[1]
    if not index.isdecimal() or not 1 <= int(index) <= count:
        raise ScenarioError(f"signal: {name!r:.40}; allowed: {field}.1 to {field}.{count}")
    return values if values.ndim == 1 else values[:, int(index) - 1]


def measured(loop: ClosedLoop, each: Measure) -> MeasuredNumber:
    """Measured number of a run that has ended. Raises ScenarioError."""
    if (each.metric is None) == (each.signal is None):
        raise ScenarioError("measure: allowed: either a signal or a metric")
    if each.metric is None:
        return taken(loop.system, loop.recording, loop.t, each)
    return _metric(loop, each.metric, each.unit)


def _metric(loop: ClosedLoop, name: str, unit: str) -> MeasuredNumber:
    metrics = {
        metric: max(value) if isinstance(value, list) else value
        for metric, value in msgspec.to_builtins(metrics_of(loop)).items()
        if metric in METRICS
    }
    there = [metric for metric, value in metrics.items() if value is not None or metric in HAPPENING]
    if name not in there:
        absent = ", which this run does not have" if name in metrics else ""
        raise ScenarioError(f"metric: {name!r:.40}{absent}; {allowed(name, there)}")
    si, value = METRICS[name].unit_in(loop.system.units) or "1", metrics[name]
    factor = factor_for(unit, si, f"the metric {name}")
    return MeasuredNumber(math.inf if value is None else factor * float(value), unit)


def taken(system: System, recording: Recording, now: float, each: Measure) -> MeasuredNumber:
    """Measured number of a signal, in a run that goes on. now: time of the run, s. Raises ScenarioError."""
    factor_of(each.unit)
    if each.metric is not None or each.signal is None:
        raise ScenarioError(f"metric: {each.metric!r}; allowed: a signal, since a goal measures a run that goes on")
    name, half = each.signal, 0.5 * system.scenario.controller.period
    start, end = each.interval(now)
    record = recording.stretch(start - half, end + half)
    if len(record["t"]) < 2:
        raise ScenarioError(f"measure of {each.signal}: nothing is recorded from {start:g} s to {end:g} s")
    values = signal_of(system, record, name)
    si, of = si_unit_of(system, name), f"the signal {name}"
    if each.statistic in OVER_TIME:
        si, of = "s", f"the statistic {each.statistic}"
    elif each.statistic == "variation":
        si, of = PER_SECOND.get(si, f"{si}/s"), f"the variation of the signal {name}"
    factor = factor_for(each.unit, si, of)
    if np.isnan(values).any():
        unknown = record["t"][np.isnan(values)]
        raise ScenarioError(
            f"measure of {each.signal}: it has no value at t = {unknown[0]:.4g} s; allowed: a start and end between "
            "which it always has one"
        )
    return MeasuredNumber(factor * _statistic(record["t"], values, each), each.unit)


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


def unmet(conditions: Iterable[Condition], known: Mapping[str, MeasuredNumber]) -> list[Unmet]:
    """Conditions that do not hold. Raises ScenarioError for a measure that is not known."""
    found: list[Unmet] = []
    for condition in conditions:
        value = _known(condition.measure, known)
        if condition.above is None and condition.below is None:
            raise ScenarioError(f"condition on {condition.measure}: no limit; allowed: above or below")
        for word, limit in (("above", condition.above), ("below", condition.below)):
            if limit is None:
                continue
            if isinstance(limit, str) and (unit := _known(limit, known).unit) != value.unit:
                raise ScenarioError(
                    f"condition on {condition.measure}: it is in {value.unit or 'no unit'}, and {limit} in "
                    f"{unit or 'no unit'}; allowed: two measures in the same unit"
                )
            bound = condition.times * (_known(limit, known).value if isinstance(limit, str) else float(limit))
            holds = value.value > bound if word == "above" else value.value < bound
            if not holds:
                found.append(Unmet(condition.measure, value, word, MeasuredNumber(bound, value.unit)))
    return found


def _known(name: str, known: Mapping[str, MeasuredNumber]) -> MeasuredNumber:
    if name not in known:
        raise ScenarioError(f"measure {name!r:.40}; {allowed(name, known)}")
    return known[name]
