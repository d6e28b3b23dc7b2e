"""Plan of a sweep: a scenario, what is varied, the true arms that are drawn, and so each of its runs."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import msgspec
import numpy as np
import tomli_w
from msgspec import Meta, Struct

from app.scenario.data import differences as fields_that_differ
from app.scenario.data import field_of, found_at, kind_of, require_few_dots, text_of, to_plain, with_value, with_values
from app.scenario.departures import DRAWN, MOVING, Departure
from app.scenario.errors import ScenarioError, UnknownChoice, UnknownField, WrongKind, scenario_errors
from app.scenario.idle_fields import idle
from app.scenario.number_text import counted
from app.scenario.schema import STATED_IN, RobotSection, Scenario
from app.scenario.struct_refusals import struct_refusal
from app.simulation.builders.controller_builder import law_of
from app.simulation.builders.environment_builder import robot_of
from app.simulation.engines import Engine
from app.storage.joint_kinds import units_of
from app.sweep.axes import Axis, Value, require_axis
from environments.catalogue import CATALOGUE
from environments.regular_file import read_regular
from parameters import allowed

MOST_ROWS = 10_000_000
UNREAD = ("name", "title")  # fields on which no run depends
LARGEST_FILE = 4_000_000  # bytes of sweep.toml
LONGEST_VALUE, MOST_NAMED = 80, 4  # letters of a value, and differences, in the refusal of another folder
LONGEST_NAME = 150  # letters of the scenario's name in that of a run's or a candidate's
FILE = "sweep.toml"
DURATION, PERIOD = "simulation.duration", "controller.period"
DRAWN_FIELDS = frozenset(f"truth.{name}" for name in DRAWN)
Design = Literal["grid", "latin", "sobol"]


class Sweep(Struct, frozen=True, forbid_unknown_fields=True):
    """Sweep: its whole definition, as it stands in sweep.toml.

    scenario: gives all fields that are not varied.
    vary: axes.
    design: grid, of all values; latin: a Latin hypercube; sobol: Sobol's sequence.
    points: of a design other than the grid.
    draw: true arms inside the declared set, the same at every point; 0: the scenario's own one.
    corners: the arms are at corners of the declared set.
    until: s, end of each run, at most its scenario's; 0 for that. An earlier end does not change the constants over
        Omega.
    seed: of arms and design.
    program: fingerprint of the program that computes it.
    """

    scenario: Scenario
    vary: tuple[Axis, ...] = ()
    design: Design = "grid"
    points: Annotated[int, Meta(ge=0)] = 0
    draw: Annotated[int, Meta(ge=0)] = 0
    corners: bool = False
    seed: Annotated[int, Meta(ge=0)] = 0
    until: Annotated[float, Meta(ge=0)] = 0.0
    engine: Engine = "compiled"
    program: str = ""
    file: ClassVar[str] = FILE
    noun: ClassVar[str] = "sweep"

    @property
    def length(self) -> float:
        """Simulated time of a run, s, where its duration is not varied."""
        return self.until or self.scenario.simulation.duration

    @property
    def arms(self) -> int:
        """Number of true arms that each point has."""
        return max(self.draw, 1)

    @property
    def seen(self) -> int:
        """Number of arms, the first ones, whose sensors have the scenario's own noise."""
        return self.arms

    @property
    def own_arms(self) -> int:
        """Number of arms, the first ones, that are the scenario's own and not drawn."""
        return 0 if self.draw else 1

    @property
    def drawn(self) -> int:
        """Number of arms that are drawn."""
        return self.arms - self.own_arms


SweepT = TypeVar("SweepT", bound=Sweep)


@dataclass(frozen=True)
class SweepRow:
    """Row: one run of a sweep. number: from 0; point, arm: numbers of its point and true arm; values: of the axes, by
    path."""

    number: int
    point: int
    arm: int
    values: dict[str, Value]


class SweepPlan:
    """A sweep with its runs. Raises ScenarioError where it makes no sense."""

    def __init__(self, sweep: Sweep) -> None:
        self.sweep = sweep
        _require_sound(sweep)

    @property
    def arms(self) -> int:
        return self.sweep.arms

    @cached_property
    def count_of_points(self) -> int:
        if self.sweep.design == "grid":
            return math.prod(len(axis.values) for axis in self.sweep.vary)
        return self.sweep.points

    @property
    def count(self) -> int:
        """Number of runs."""
        return self.count_of_points * self.arms

    def seconds_of(self, numbers: np.ndarray) -> float:
        """Simulated time of the runs of these numbers, s, where none stops; 0 of one that is refused for its
        duration."""
        sweep = self.sweep
        at = next((k for k, axis in enumerate(sweep.vary) if axis.path == DURATION), None)
        if at is None or sweep.until:
            return len(numbers) * sweep.length
        axis, points = sweep.vary[at], np.asarray(numbers, dtype=int) // self.arms
        if sweep.design == "grid":
            values, places = axis.values, np.unravel_index(points, [len(axis.values) for axis in sweep.vary])[at]
        else:
            values, places = [axis.at(float(position)) for position in self._unit_points[:, at]], points
        return float(np.array([max(float(value), 0.0) for value in values])[places].sum())

    def row(self, number: int) -> SweepRow:
        """Run of this number. Raises ScenarioError for one that there is not."""
        if not 0 <= number < self.count:
            raise ScenarioError(f"--row {number}; allowed: 0 to {self.count - 1}")
        point, arm = divmod(number, self.arms)
        return SweepRow(number, point, arm, self.values_at(point))

    def values_at(self, point: int) -> dict[str, Value]:
        """Values of the axes at a point, by path."""
        axes = self.sweep.vary
        if self.sweep.design == "grid":
            places = np.unravel_index(point, [len(axis.values) for axis in axes]) if axes else ()
            return {axis.path: axis.values[int(k)] for axis, k in zip(axes, places, strict=True)}
        return {axis.path: axis.at(float(u)) for axis, u in zip(axes, self._unit_points[point], strict=True)}

    def key_columns(self, row: SweepRow) -> dict[str, Any]:
        """Columns of the table that identify a run."""
        varied = {
            axis.path: row.values[axis.path] if axis.numeric else str(row.values[axis.path])
            for axis in self.sweep.vary
            if axis.path in row.values
        }
        return {"row": row.number, "point": row.point, "arm": row.arm, **varied}

    def scenario(self, row: SweepRow) -> Scenario:
        """Scenario of a run. Raises ScenarioError where its values are refused."""
        base = self.sweep.scenario
        # a section that is of its kind already keeps its fields
        changed = {path: value for path, value in row.values.items() if _kind_at(base, path) != value}
        scenario = with_values(base, changed)
        if row.arm >= self.sweep.own_arms:
            departure = self._departure(row.arm, _joints(scenario.robot))
            scenario = msgspec.structs.replace(scenario, truth=departure.truth(scenario.declared, of=scenario.truth))
        if row.arm >= self.sweep.seen:  # gains that suit one sequence of noise are no better under another one
            seed = (scenario.simulation.seed + 1 + row.arm - self.sweep.seen) % 2**63
            simulation = msgspec.structs.replace(scenario.simulation, seed=seed)
            scenario = msgspec.structs.replace(scenario, simulation=simulation)
        return msgspec.structs.replace(scenario, name=f"{self.sweep.scenario.name[:LONGEST_NAME]}-{row.number}")

    @cached_property
    def _unit_points(self) -> np.ndarray:
        """Points (N, k) of a design in the unit cube."""
        from scipy.stats import qmc  # a page without a map need not load it

        axes, points, rng = len(self.sweep.vary), self.sweep.points, np.random.default_rng(self.sweep.seed)
        if self.sweep.design == "latin":
            return qmc.LatinHypercube(axes, rng=rng).random(points)
        return qmc.Sobol(axes, rng=rng).random_base2(max(points - 1, 0).bit_length())[:points]

    def _departure(self, arm: int, n: int) -> Departure:
        random = np.random.default_rng([self.sweep.seed, arm, n])
        return Departure.edge(random, n) if self.sweep.corners else Departure.inside(random, n)


@lru_cache(maxsize=16)
def _joints(robot: RobotSection) -> int:
    with scenario_errors():
        return robot_of(Scenario(robot=robot)).n


def _kind_at(scenario: Scenario, path: str) -> str | None:
    """Kind of the section at this dotted path, None where there is another field."""
    found = found_at(scenario, path)
    return kind_of(found) if isinstance(found, Struct) and found.__struct_config__.tag is not None else None


def _require_sound(sweep: Sweep) -> None:
    law_of(sweep.scenario)
    paths = [axis.path for axis in sweep.vary]
    if twice := next((path for path in paths if paths.count(path) > 1), None):
        raise ScenarioError(f"vary: {twice} twice; allowed: each field once")
    for path in paths:
        if inner := next((each for each in paths if each.startswith(f"{path}.")), None):
            raise ScenarioError(f"vary: {inner} beside {path}, of which it is a part; allowed: one of both")
    if sweep.draw and (both := [path for path in paths if field_of(path) in DRAWN_FIELDS]):
        raise ScenarioError(f"vary: {both[0]} is drawn for each true arm; allowed: without --draw")
    if sweep.corners and not sweep.draw:
        raise ScenarioError("corners: no arm is drawn; allowed: with --draw")
    if sweep.design == "grid":
        if ranges := [axis.path for axis in sweep.vary if not axis.values]:
            raise ScenarioError(f"vary: {ranges[0]} is a range; allowed: LOW:HIGH:COUNT, or --design latin or sobol")
        if sweep.points:
            raise ScenarioError(f"points: {sweep.points} in a grid; allowed: with --design latin or sobol")
    elif not sweep.vary or not sweep.points:
        given = f"{counted(sweep.points, 'point')}, {counted(len(paths), 'varied field')}"
        raise ScenarioError(f"design: {sweep.design!r} with {given}; allowed: 1 or more of each")
    _require_until(sweep)
    for axis in sweep.vary:
        if axis.path in UNREAD:
            raise ScenarioError(f"vary: {axis.path}; allowed: fields on which a run depends")
        unused = idle(sweep.scenario, axis.path)
        if unused is not None and unused.choice not in paths:
            raise ScenarioError(
                f"vary: {axis.path} has no effect {unused.because}; allowed: with {unused.choice} "
                f"{' or '.join(unused.needed)}, such as with --set {unused.choice}={unused.needed[0]}"
            )
        require_axis(axis)
        ends = (axis.at(0.0), axis.at(1.0))
        for value in ends if axis.numeric else axis.values:
            _require_known(sweep.scenario, axis.path, value)
    points = math.prod(len(axis.values) for axis in sweep.vary) if sweep.design == "grid" else sweep.points
    if (runs := points * sweep.arms) > MOST_ROWS:
        number = f"{min(runs, 10**300):.3g}"  # of a number of any length
        raise ScenarioError(f"{sweep.noun}: {number} runs; allowed: at most {MOST_ROWS:.0e}")
    if sweep.drawn and (stated := stated_bound(sweep)):
        asked = "draw" if sweep.draw else sweep.noun
        own = ", or the scenario's own arm, without --draw" if sweep.arms == sweep.draw else ""
        raise ScenarioError(
            f"{asked}: {stated} is stated, and only its run shows whether a true arm is within it; allowed: "
            f"in its place bounds of links, payload and friction, such as declared.link_scaling{own}"
        )
    if sweep.draw > 1 and not arms_differ(sweep):
        raise ScenarioError(
            f"draw: {sweep.draw} true arms that are all alike, since no quantity that is drawn is declared; allowed: a "
            "bound above 0, such as declared.link_scaling, or the scenario's own arm, without --draw"
        )


def arms_differ(sweep: Sweep) -> bool:
    """Whether true arms that are drawn are not all alike: a quantity that is drawn is declared, or its bound varied."""
    varied = {field_of(axis.path) for axis in sweep.vary}
    return any(getattr(sweep.scenario.declared, name) or f"declared.{name}" in varied for name in MOVING)


def stated_bound(sweep: Sweep) -> str | None:
    """Path of a bound that is stated in place of others, or varied; None for none."""
    varied = {field_of(axis.path) for axis in sweep.vary}
    paths = {name: f"declared.{name}" for name in STATED_IN}
    stated = (path for name, path in paths.items() if getattr(sweep.scenario.declared, name) is not None)
    return next(stated, None) or next((path for path in paths.values() if path in varied), None)


def require_not_drawn(sweep: Sweep, given: Mapping[str, object]) -> None:
    """Raise ScenarioError where a field that a user has set is drawn for each true arm, so that its value would have no
    effect. given: values by dotted path, as with `--set`."""
    truth = given.get("truth")
    paths = [*given, *(f"truth.{name}" for name in truth)] if isinstance(truth, dict) else list(given)
    if sweep.draw and (both := [path for path in paths if field_of(path) in DRAWN_FIELDS]):
        raise ScenarioError(f"--set {both[0]}: it is drawn for each true arm; allowed: without --draw")


def _require_until(sweep: Sweep) -> None:
    """Raise ScenarioError where runs have to go on after their duration, from which on their constants do not hold."""
    varied = next((axis for axis in sweep.vary if axis.path == DURATION and axis.numeric), None)
    durations = (sweep.scenario.simulation.duration,) if varied is None else varied.values or (varied.low,)
    period = sweep.scenario.controller.period
    if sweep.until and sweep.until < period and PERIOD not in {axis.path for axis in sweep.vary}:
        raise ScenarioError(f"until: {sweep.until:g} s; allowed: at least {period:g} s, a control period")
    if sweep.until and not sweep.until <= min(map(float, durations)):
        raise ScenarioError(
            f"until: {sweep.until:g} s; allowed: at most {min(map(float, durations)):g} s, the duration of the runs"
        )


def _require_known(scenario: Scenario, path: str, value: Value) -> None:
    """Raise ScenarioError where a field is unknown, is no field for a value of this kind, or has no such choice, and
    where the value would change the units of the table; another value that is refused makes a row that says so."""
    try:
        changed = with_value(scenario, path, value)
    except (UnknownField, UnknownChoice, WrongKind):
        raise
    except ScenarioError:
        return
    if path == "controller.law":
        law_of(changed)
    if path == "robot.name" and value not in CATALOGUE:
        raise ScenarioError(f"robot.name: {value!r:.60}; {allowed(str(value), CATALOGUE)}")
    if changed.task_space.kind != scenario.task_space.kind:
        raise ScenarioError(
            f"vary: {path}: {value} beside {scenario.task_space.kind} would put m and rad, N and N·m into one column; "
            f"allowed: one sweep for each kind, such as with --set task_space.kind={changed.task_space.kind}"
        )
    if units_of(changed) != units_of(scenario):
        raise ScenarioError(
            f"vary: {path}: {value} would put numbers of revolute and of prismatic joints, N·m and N, into one column; "
            "allowed: one sweep for each"
        )


def to_toml(sweep: Sweep) -> str:
    """TOML of the whole definition. Raises ScenarioError where it would be larger than what is read."""
    plain = msgspec.to_builtins(sweep)
    plain["scenario"] = to_plain(sweep.scenario)
    text = tomli_w.dumps(plain)
    if len(text.encode()) > LARGEST_FILE:
        raise ScenarioError(
            f"vary: {len(text) / 1e6:.1f} MB of values; allowed: {LARGEST_FILE / 1e6:g} MB, or ranges of a design"
        )
    return text


def read(path: Path, kind: type[SweepT] = Sweep) -> SweepT:
    """Sweep, or another definition of this kind, of a file. Raises ScenarioError."""
    try:
        content = read_regular(path, LARGEST_FILE + 1)
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from error
    if len(content) > LARGEST_FILE:
        raise ScenarioError(f"{path}: more than {LARGEST_FILE / 1e6:g} MB; allowed: a {kind.file}")
    try:
        text = text_of(content)
        require_few_dots(text)
        data = tomllib.loads(text)
    except (ScenarioError, ValueError, RecursionError) as error:
        raise ScenarioError(f"{path}: not a TOML file: {error}") from error
    try:
        return msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        reason = struct_refusal(error, data, kind)
        raise ScenarioError(f"{path}: {reason} (`vsmrc {Path(kind.file).stem}` writes this file)") from error
    except RecursionError as error:
        raise ScenarioError(f"{path}: nested without end; allowed: a {kind.file} as it was written") from error


def differences(kept: Sweep, asked: Sweep) -> dict[str, tuple[object, object]]:
    """Parts in which two sweeps differ, each with both values: of the scenario its fields, by dotted path."""
    pairs: dict[str, tuple[object, object]] = dict(fields_that_differ(kept.scenario, asked.scenario))
    for name in UNREAD:
        pairs[name] = (getattr(kept.scenario, name), getattr(asked.scenario, name))
    for name in kept.__struct_fields__:
        if name != "scenario":
            pairs[name] = (getattr(kept, name), getattr(asked, name))
    return {path: (one, other) for path, (one, other) in pairs.items() if one != other}


def differences_in_words(found: Mapping[str, tuple[object, object]]) -> str:
    """Differences of two sweeps in words, the first few of them; "" where only the program is another one."""
    texts = [f"{path} {_short(a)} there, {_short(b)} here" for path, (a, b) in found.items() if path != "program"]
    more = f"; and {len(texts) - MOST_NAMED} more" if len(texts) > MOST_NAMED else ""
    return "; ".join(texts[:MOST_NAMED]) + more


def _short(value: object) -> str:
    """Value of a part of a definition, in few letters."""
    if isinstance(value, tuple):
        text = " ".join(map(str, value)) or "not given"
    else:
        text = "not given" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
    return text if len(text) <= LONGEST_VALUE else f"{text[: LONGEST_VALUE - 1]}…"
