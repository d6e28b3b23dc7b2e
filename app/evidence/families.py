"""Families of arms: a map over stiffness and true masses, and the band of a thousand true arms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from app.analysis.metrics import motion_error
from app.evidence.plants import largest_ratio
from app.evidence.section import EvidenceSection, Findings, Job, of_kind
from app.export.figures import Curve, Figure, FigureChart, FilledArea
from app.export.printing import render
from app.scenario.data import edited, shipped
from app.session.headless_run import simulate
from app.simulation.system import System
from app.storage.constants_store import kept_memory
from app.sweep.axes import axis_of
from app.sweep.charts import chart
from app.sweep.plan import Sweep, SweepPlan
from app.sweep.points import SweepView
from app.sweep.run_metrics import RunMetrics, SweepRunner, columns_of
from app.sweep.titles import value_in_words

LAWS = ("vsmrc", "computed-torque")
MAP_DURATION, MAP_AXES = 3.0, ("contact.K_e=1e3:1e5:13:log", "truth.link_scaling=0.7:1.4:15")
ARMS, BAND_DURATION, INSTANTS = 1000, 1.0, 200
CHUNK = 25  # runs in a job
QUANTILES = (0.0, 0.05, 0.5, 0.95, 1.0)
BLUE, RED = (86, 180, 233), (235, 80, 80)
MM = 1e3


@dataclass(frozen=True)
class Rows:
    """Rows of a law's map, one for each run."""

    law: str
    rows: list[RunMetrics]


@dataclass(frozen=True)
class Arms:
    """Arms of a law's band, or some of them.
    s: ||s||, (arms, instants), m/s.
    bound: (20) with its band, (arms, instants), m/s, NaN where nothing is promised.
    error: of the position, (arms, instants), m.
    ratio: largest ||s|| over that bound, see `largest_ratio`.
    holds: number of arms whose promise was made and kept throughout.
    broken: number of arms whose promise was not kept."""

    law: str
    s: np.ndarray
    bound: np.ndarray
    error: np.ndarray
    ratio: float
    holds: int
    broken: int


def map_of(law: str) -> Sweep:
    """Sweep of a law's map."""
    scenario = edited(edited(shipped()["ur5-hybrid"], "simulation.duration", MAP_DURATION), "controller.law", law)
    return Sweep(scenario, tuple(map(axis_of, MAP_AXES)))


def band_of(law: str) -> Sweep:
    """Sweep of a law's band: one point, many arms."""
    scenario = edited(shipped()["ur5-hybrid-reaching"], "simulation.duration", BAND_DURATION)
    return Sweep(edited(scenario, "controller.law", law), draw=ARMS)


def map_rows(law: str, numbers: tuple[int, ...]) -> Rows:
    """Rows of a law's map. numbers: of the rows."""
    runner = SweepRunner(map_of(law))
    return Rows(law, [runner.metrics(number) for number in numbers])


def arms(law: str, numbers: tuple[int, ...]) -> Arms:
    """Arms of a law's band. numbers: of the arms."""
    plan, memory = SweepPlan(band_of(law)), kept_memory()
    system: System | None = None
    runs, ratio, holds, broken = [], 0.0, 0, 0
    for number in numbers:
        loop, metrics = simulate(plan.scenario(plan.row(number)), engine="compiled", previous=system, memory=memory)
        system = loop.system
        record = loop.recording.signals(("t", "s_norm", "s_bound", "s_band", "e_r", "tool"))
        ratio = max(ratio, largest_ratio(record))
        few = np.linspace(0, len(record["t"]) - 1, INSTANTS).round().astype(int)
        record = {name: values[few] for name, values in record.items()}
        error = np.linalg.norm(motion_error(system, record), axis=1)
        runs.append((record["s_norm"], record["s_bound"] + record["s_band"], error))
        holds += metrics.promise.verdict == "holds"
        broken += metrics.promise.verdict == "broken"
    s, bound, errors = (np.array(each) for each in zip(*runs, strict=True))
    return Arms(law, s, bound, errors, ratio, holds, broken)


def jobs(thin: int) -> Sequence[Job]:
    made = []
    for law in LAWS:
        for function, count in ((map_rows, SweepPlan(map_of(law)).count), (arms, ARMS)):
            numbers = range(0, count, thin) if function is arms else range(count)
            made += [Job(function, (law, tuple(numbers[k : k + CHUNK]))) for k in range(0, len(numbers), CHUNK)]
    return made


def conclude(results: Sequence[object]) -> Findings:
    tables = {law: [row for each in of_kind(Rows, results) if each.law == law for row in each.rows] for law in LAWS}
    bands = {law: [each for each in of_kind(Arms, results) if each.law == law] for law in LAWS}
    robust = bands["vsmrc"]
    columns = {law: columns_of(tables[law]) for law in LAWS}
    worst = {law: columns[law]["force_error"] for law in LAWS}
    inside = {law: columns[law]["declared"] == 1.0 for law in LAWS}
    numbers = {
        "arms": str(sum(len(each.s) for each in robust)),
        "holds": str(sum(each.holds for each in robust)),
        "broken": str(sum(each.broken for each in robust)),
        "ratio": f"{max(each.ratio for each in robust):.2f}",
        "points": str(len(tables["vsmrc"])),
        "edge": _error_at(columns["vsmrc"], 1e4, 1.15),
        "beyond": _error_at(columns["vsmrc"], 1e4, 1.3),
        **{
            f"{short}_{name}": f"{np.nanmax(worst[law][inside[law] if name == 'inside' else ~inside[law]]):.2g}"
            for law, short in zip(LAWS, ("robust", "torque"), strict=True)
            for name in ("inside", "outside")
        },
        **{
            f"{short}_path": f"{MM * max(each.error[:, INSTANTS // 2 :].max() for each in bands[law]):.2g}"
            for law, short in zip(LAWS, ("robust", "torque"), strict=True)
        },
    }
    maps = {law: _map(law, tables[law]) for law in LAWS}
    return Findings(numbers, {}, {"map": maps["vsmrc"], "torque_map": maps["computed-torque"], "band": _band(bands)})


def _error_at(columns: dict[str, np.ndarray], stiffness: float, scaling: float) -> str:
    """Force error of the run of a map at this stiffness (N/m) and factor on the true masses, mN, as text; "–" where the
    map has no such run."""
    there = np.isclose(columns["contact.K_e"], stiffness) & np.isclose(columns["truth.link_scaling"], scaling)
    return f"{1e3 * columns['force_error'][there][0]:.2g}" if there.any() else "–"


def _map(law: str, rows: list[RunMetrics]) -> bytes:
    sweep = map_of(law)
    titled = msgspec.structs.replace(sweep.scenario, name=f"ur5-hybrid, {value_in_words('controller.law', law)}")
    return chart(msgspec.structs.replace(sweep, scenario=titled), columns_of(rows), SweepView("force_error"), "svg")


def _band(bands: dict[str, list[Arms]]) -> bytes:
    t = np.linspace(0.0, BAND_DURATION, INSTANTS)
    robust = bands["vsmrc"]
    s = _quantiles(np.concatenate([each.s for each in robust]))
    bound = np.nanmin(np.concatenate([each.bound for each in robust]), axis=0)
    allowed = Curve("bound (20) + band, the least of all arms", RED, t, MM * bound, dashed=True)
    charts = [_chart(f"‖s‖, {value_in_words('controller.law', 'vsmrc')}", "mm/s", t, MM * s, (allowed,))]
    for law in LAWS:
        error = _quantiles(np.concatenate([each.error for each in bands[law]]))
        charts.append(_chart(f"position error, {value_in_words('controller.law', law)}", "mm", t, MM * error, ()))
    count = sum(len(each.s) for each in robust)
    caption = (
        f"{count} true arms inside the declared set, ur5-hybrid-reaching: least, 5 %, median, 95 % and largest at each "
        "instant."
    )
    return render(Figure(tuple(charts), caption, one_column=1), "svg")


def _quantiles(values: np.ndarray) -> np.ndarray:
    return np.maximum(np.quantile(values, QUANTILES, axis=0), 1e-9)


def _chart(title: str, unit: str, t: np.ndarray, values: np.ndarray, more: tuple[Curve, ...]) -> FigureChart:
    names = ("least", "5 %", "median", "95 %", "largest")
    curves = tuple(
        Curve(name, BLUE, t, line, width=1.2 if name == "median" else 0.4, listed=name == "median")
        for name, line in zip(names, values, strict=True)
    )
    return FigureChart(
        title, unit, (*curves, *more), areas=(FilledArea(4, 0, BLUE), FilledArea(3, 1, BLUE)), logarithmic=True
    )


SECTION = EvidenceSection("families", jobs, conclude)
