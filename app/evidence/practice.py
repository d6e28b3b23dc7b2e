"""Maps of the loop's quality with non-ideal sensor, computer and drives, over two of their parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.analysis.metrics import account, saturated
from app.evidence.drawing import HeatMap, heat_maps
from app.evidence.section import EvidenceSection, Findings, Job
from app.process.markdown import Table
from app.scenario.data import edited, shipped
from app.scenario.schema import Scenario
from app.session.headless_run import play
from app.simulation.closed_loop import ClosedLoop
from app.simulation.sampled_loop.sampled_stability import sampled_loop
from app.simulation.system import System
from controllers.premises import Premise

DURATION, SETTLED = 4.0, 1.5  # s, length of a run, and instant from which on its metrics count
STEP = 5e-4  # s, longest step of the plant
FORCE_GOOD, PATH_GOOD, VARIATION_GOOD = 1.0, 1e-3, 1e3  # N, m, N m/s

Changes = Mapping[str, Any]


@dataclass(frozen=True)
class Cell:
    """Cell of a map: metrics of one run from `SETTLED` on, nan where the run stopped early.
    force, path: RMS errors, N and m.
    variation: of the torques, N m/s.
    saturated: share of the control periods in which a torque was cut.
    growth: of the sampled loop per period, predicted by `sampled_loop`, nan where it predicts nothing.
    layer_factor: of the sampled boundary layer.
    load: largest torque over its joint's limit in the URDF."""

    force: float
    path: float
    variation: float
    saturated: float
    growth: float
    layer_factor: float
    load: float


@dataclass(frozen=True)
class MapSweep:
    """Sweep of a map: a scenario with changes, over the values of two fields.

    x, y: paths of the fields.
    xs, ys: their values.
    x_label, y_label: names of the axes, with units.
    x_tick, y_tick: return the label of a value, in the axis' unit.
    substeps: whether the plant's step is kept at `STEP` or below.
    """

    scenario: str
    changes: Changes
    x: str
    xs: tuple[float, ...]
    y: str
    ys: tuple[float, ...]
    x_label: str
    y_label: str
    x_tick: Callable[[float], str]
    y_tick: Callable[[float], str]

    def thinned(self, thin: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Values of both fields that are computed: one in `thin` of them, and the last of y."""
        ys = self.ys[::thin]
        return self.xs[::thin], ys if ys[-1] == self.ys[-1] else (*ys, self.ys[-1])


FORCE_WAVE = {"kind": "sinusoid", "value": 20.0, "amplitude": 5.0, "frequency": 0.5}
# Hz, 0 for none, which comes last
CUTOFFS = (5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 0.0)


def _milliseconds(value: float) -> str:
    return f"{1e3 * value:g}"


def _divided(noise: MapCells, cutoff: float) -> str:
    """Median number by which a low-pass of this cutoff (Hz) divides the torque variation; a dash where the map has no
    such row."""
    if cutoff not in noise.ys:
        return "—"
    values = noise["variation"]
    return f"{np.nanmedian(values[-1] / values[list(noise.ys).index(cutoff)]):.2g}"


def _cutoff(value: float) -> str:
    return f"{value:g}" if value else "none"


SWEEPS: dict[str, MapSweep] = {
    "delay": MapSweep(
        "ur5-hybrid", {"force": FORCE_WAVE},
        "sensor.delay", (0.0, 2e-3, 5e-3, 0.01, 0.02, 0.03, 0.04, 0.06, 0.08, 0.1), "sensor.cutoff", CUTOFFS,
        "delay of the force sensor [ms]", "its low-pass [Hz]", _milliseconds, _cutoff,
    ),
    "noise": MapSweep(
        "ur5-hybrid", {"force": FORCE_WAVE},
        "sensor.noise", (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0), "sensor.cutoff", CUTOFFS,
        "noise, σ per axis [N]", "low-pass [Hz]", "{:g}".format, _cutoff,
    ),
    "period": MapSweep(
        "ur5-motion", {"motion.period": 2.0},
        "controller.period", (2e-4, 5e-4, 1e-3, 2e-3, 3e-3, 5e-3, 1e-2), "controller.layer",
        (1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1),
        "control period [ms]", "layer s_b [mm/s]", _milliseconds, _milliseconds,
    ),
    "drives": MapSweep(
        "ur5-motion", {"motion.ramp": 1.0},
        "motion.period", (4.0, 3.0, 2.0, 1.5, 1.2, 1.0, 0.8, 0.7, 0.6), "truth.torque_limit",
        (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0, 1.5, 0.0),
        "speed on the circle [m/s]", "torque limit, of the URDF's", lambda period: f"{2 * np.pi * 0.1 / period:.2g}",
        lambda limit: f"{100 * limit:g} %" if limit else "none",
    ),
}  # fmt: skip


def row(name: str, y: float, xs: Sequence[float]) -> list[Cell]:
    """Cells of one row of a map. name: of the map. y: value of the row."""
    sweep, cells, system = SWEEPS[name], [], None
    base = edited(shipped()[sweep.scenario], "simulation.duration", DURATION)
    for path, value in {**sweep.changes, sweep.y: y}.items():
        base = edited(base, path, value)
    for x in xs:
        cell, system = _cell(edited(base, sweep.x, x), system)
        cells.append(cell)
    return cells


def _cell(scenario: Scenario, previous: System | None) -> tuple[Cell, System]:
    substeps = max(1, round(scenario.controller.period / STEP))
    loop = ClosedLoop.from_scenario(edited(scenario, "simulation.substeps", substeps), previous=previous)
    growth = sampled_loop(loop.system, loop.system.robot.posture, 0.0).premises[Premise.SAMPLED_LOOP]
    layer_factor = loop.view().live["layer_loop_factor"]
    play(loop, round(DURATION / loop.period))
    known = None if loop.stopped else account(loop.system, loop.recording, SETTLED, loop.t)
    tau = loop.recording.signals(("tau", "tau_applied"), SETTLED)
    load = float((np.abs(tau["tau"]) / loop.system.robot.model.effortLimit).max()) if known else np.nan
    cell = Cell(
        force=np.nan if known is None or known.force_rms is None else known.force_rms,
        path=np.nan if known is None or known.path_rms is None else known.path_rms,
        variation=known.variation if known else np.nan,
        saturated=float(saturated(tau).mean()) if known else np.nan,
        growth=growth,
        layer_factor=layer_factor,
        load=load,
    )
    return cell, loop.system


def jobs(thin: int) -> list[Job]:
    found = []
    for name, sweep in SWEEPS.items():
        xs, ys = sweep.thinned(thin)
        found += [Job(row, (name, y, xs)) for y in ys]
    return found


class MapCells:
    """Cells of one map."""

    def __init__(
        self, sweep: MapSweep, xs: tuple[float, ...], ys: tuple[float, ...], rows: Sequence[Sequence[Cell]]
    ) -> None:
        self._sweep, self.xs, self.ys, self._rows = sweep, xs, ys, rows

    def __getitem__(self, field: str) -> np.ndarray:
        """Values (l, k) of a figure in every cell."""
        return np.array([[getattr(cell, field) for cell in cells] for cells in self._rows])

    def map(
        self, title: str, unit: str, values: np.ndarray, ends: tuple[float, float], good: float,
        theory: tuple[np.ndarray, float] | None = None,
    ) -> HeatMap:  # fmt: skip
        """Heat map of a figure."""
        sweep = self._sweep
        ticks = [sweep.x_tick(x) for x in self.xs], [sweep.y_tick(y) for y in self.ys]
        return HeatMap(title, unit, sweep.x_label, sweep.y_label, *ticks, values, ends, good, theory)


def _shape(thin: int) -> list[int]:
    """Length of each row of all maps, of one in `thin` of the values."""
    return [len(xs) for xs, ys in (sweep.thinned(thin) for sweep in SWEEPS.values()) for _ in ys]


def conclude(results: Sequence[list[Cell]]) -> Findings:
    found, grids = iter(results), {}
    shape = [len(row) for row in results]
    thin = next(thin for thin in range(1, 100) if _shape(thin) == shape)
    for name, sweep in SWEEPS.items():
        xs, ys = sweep.thinned(thin)
        grids[name] = MapCells(sweep, xs, ys, [next(found) for _ in ys])
    delay, noise, period, drives = (grids[name] for name in SWEEPS)
    needed = np.broadcast_to(np.nanmax(drives["load"][-1:], axis=0), drives["load"].shape)
    limits = np.array([limit or np.inf for limit in drives.ys])[:, None]
    growth = (delay["growth"], 1.0)
    figures = {
        "delay": heat_maps(
            (
                delay.map("force error, RMS", "N", delay["force"], (0.01, 100.0), FORCE_GOOD, growth),
                delay.map("variation of τ", "N·m/s", delay["variation"], (10.0, 1e5), VARIATION_GOOD, growth),
            ),
            "Dotted: beyond it the linearised sampled loop is unstable. "
            f"White: {FORCE_GOOD:g} N, {VARIATION_GOOD:g} N·m/s. ×: the run stopped.",
        ),
        "noise": heat_maps(
            (
                noise.map("force error, RMS", "N", noise["force"], (0.01, 100.0), FORCE_GOOD),
                noise.map("variation of τ", "N·m/s", noise["variation"], (10.0, 1e5), VARIATION_GOOD),
            ),
            f"White: {FORCE_GOOD:g} N, {VARIATION_GOOD:g} N·m/s.",
        ),
        "period": heat_maps(
            (
                period.map(
                    "path error, RMS", "mm", 1e3 * period["path"], (0.01, 10.0), 1e3 * PATH_GOOD,
                    (period["layer_factor"], 2.0),
                ),
                period.map(
                    "variation of τ", "N·m/s", period["variation"], (10.0, 1e5), VARIATION_GOOD,
                    (period["layer_factor"], 2.0),
                ),
            ),
            "Dotted: beyond it the factor of the sampled boundary layer is over 2. "
            f"White: {1e3 * PATH_GOOD:g} mm, {VARIATION_GOOD:g} N·m/s. ×: the run stopped.",
        ),
        "drives": heat_maps(
            (
                drives.map(
                    "path error, RMS", "mm", 1e3 * drives["path"], (0.01, 10.0), 1e3 * PATH_GOOD,
                    (needed / limits, 1.0),
                ),
                drives.map(
                    "time at the limit", "%", np.maximum(100 * drives["saturated"], 1e-9), (0.1, 100.0), 0.1,
                    (needed / limits, 1.0),
                ),
            ),
            "Dotted: beyond it the torque that the same run takes without limits is more than there is. "
            f"White: {1e3 * PATH_GOOD:g} mm, 0.1 %. ×: the run stopped.",
        ),
    }  # fmt: skip
    return Findings(_numbers(delay, noise, period, drives, needed / limits), _tables(grids), figures)


def _numbers(delay: MapCells, noise: MapCells, period: MapCells, drives: MapCells, load: np.ndarray) -> dict[str, str]:
    def agreement(beyond: np.ndarray, bad: np.ndarray) -> str:
        return f"{int((beyond == bad).sum())} of {bad.size}"

    unfiltered = delay["force"][-1]
    good = [value for value, error in zip(delay.xs, unfiltered, strict=True) if error < FORCE_GOOD]
    swinging = ~(delay["force"] < 5 * FORCE_GOOD)
    chattering = ~(period["variation"] < VARIATION_GOOD)
    return {
        "delay_agreement": agreement(delay["growth"] > 1.0, swinging),
        "delay_kept": f"{1e3 * max(good):g}" if good else "no",
        "noise_share": f"{np.nanmedian(noise['force'][-1] / np.array(noise.xs)):.2g}",
        "noise_50": _divided(noise, 50.0),
        "noise_20": _divided(noise, 20.0),
        "noise_variation": f"{np.nanmedian(noise['variation'][-1] / np.array(noise.xs)):.3g}",
        "period_agreement": agreement(period["layer_factor"] > 2.0, chattering),
        "drives_agreement": agreement(load > 1.0, ~(drives["saturated"] <= 0.0)),
        "drives_lost": f"{int((~(1e3 * drives['path'] < 1e3 * PATH_GOOD)).sum())} of {drives['path'].size}",
        "force_good": f"{FORCE_GOOD:g}",
        "variation_good": f"{VARIATION_GOOD:g}",
    }


def _tables(grids: Mapping[str, MapCells]) -> dict[str, Table]:
    """Tables with a row of each map in numbers."""
    delay = grids["delay"]
    header = ("force error, RMS [N]", *(f"delay {1e3 * x:g} ms" for x in delay.xs))
    rows = [
        (f"low-pass {_cutoff(y)}" + (" Hz" if y else ""), *(_shown(value) for value in values))
        for y, values in zip(delay.ys, delay["force"], strict=True)
    ]
    return {"delay": Table(header, rows)}


def _shown(value: float) -> str:
    return "stopped" if np.isnan(value) else f"{value:.2g}"


SECTION = EvidenceSection("practice", jobs, conclude)
