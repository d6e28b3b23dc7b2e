"""Theorem 1 on random arms: whether its promise is made at the shipped control period and kept, an adversary's search,
and arms outside of the declared set."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from app.analysis.perturbation import PARTS
from app.evidence.adversary import GENERATIONS, Hunt, hunt
from app.evidence.arms import (
    SCALES,
    Deadline,
    DrawnPlant,
    Example,
    Outside,
    Reaching,
    RefusedPlant,
    example,
    lag,
    outside,
    reach,
)
from app.evidence.drawing import charts_in_columns
from app.evidence.plants import BOUNDS
from app.evidence.section import EvidenceSection, Findings, Job, of_kind
from app.export.figures import Curve, FigureChart
from app.process.markdown import Table
from controllers.bounds import CAUSES

ROBOTS = ("ur3", "ur5", "ur10", "panda", "xarm7", "z1", "planar2r", "planar3r")
MODES = ("motion", "impedance", "hybrid", "hybrid-impedance", "constrained")
SITUATIONS = 5  # of each robot in each mode; with `arms.PLANTS` plants in each, 1,000 in all
OUTSIDE_ROBOTS = ("ur5", "planar3r")
OUTSIDE = 3  # situations of each robot in each mode, each with an arm outside of the declared set
VERDICTS = ("holds", "broken", "nothing promised")
PALETTE = (
    (66, 135, 245), (230, 159, 0), (0, 158, 115), (204, 121, 167),
    (86, 180, 233), (213, 94, 0), (150, 140, 30), (110, 80, 170),
)  # fmt: skip
COLORS = dict(zip(ROBOTS, PALETTE, strict=True))
BLUE, ORANGE, GREY = (66, 135, 245), (230, 159, 0), (120, 120, 120)


def jobs(thin: int) -> list[Job]:
    cells = [(robot, mode, seed) for seed in range(SITUATIONS) for robot in ROBOTS for mode in MODES]
    away = [(robot, mode, seed) for seed in range(OUTSIDE) for robot in OUTSIDE_ROBOTS for mode in MODES]
    hunts = [(robot, mode, (i + j) % 2 == 1) for i, robot in enumerate(ROBOTS) for j, mode in enumerate(MODES)]
    mixed = np.random.default_rng(0)  # mixes the cells, so that a few of them are of all kinds
    mixed.shuffle(cells)
    mixed.shuffle(away)
    mixed.shuffle(hunts)
    return [
        Job(example),
        *(Job(hunt, (*cell, max(GENERATIONS // thin, 1))) for cell in hunts[::thin]),
        *(Job(reach, cell) for cell in cells[::thin]),
        *(Job(lag, (robot,)) for robot in ROBOTS[::thin]),
        *(Job(outside, cell) for cell in away[::thin]),
    ]


def conclude(results: Sequence[Any]) -> Findings:
    shown, hunts = of_kind(Example, results)[0], of_kind(Hunt, results)
    runs = [one for batch in of_kind(list, results) for one in batch]
    drawn_ones, away = of_kind(DrawnPlant, runs), of_kind(Outside, runs)
    plants = [one for one in drawn_ones if not one.lagging]
    late = [one for one in of_kind(Reaching, drawn_ones) if one.lagging]
    numbers = _of_plants(plants) | _of_hunts(hunts) | _of_outside(away)
    numbers |= {
        "lag_plants": f"{len(late)}",
        "lag_promised": f"{sum(one.promised_fraction > 0.0 for one in late)}",
        "lag_over": f"{sum(one.excess > 0.0 for one in late)}",
        "lag_used": _largest(one.used for one in late),
    }
    figures = {
        "example": charts_in_columns(
            (_run_chart(shown),), "A UR5 that presses, first of its plants: drawn('ur5', 'hybrid', 0, 0)."
        ),
        "spread": charts_in_columns(
            _spread_charts(of_kind(Reaching, plants)), "Share of the plants that stay below the value on the axis."
        ),
        "outside": charts_in_columns(
            _outside_charts(away), "Corners of the declared set moved away from the nominal arm."
        ),
    }
    tables = {
        "cells": _cells(plants),
        "failures": _failures(plants),
        "hunts_table": _hunted(hunts),
        "shares": _fractions(of_kind(Reaching, plants)),
    }
    return Findings(numbers=numbers, tables=tables, figures=figures)


def _of_plants(plants: Sequence[DrawnPlant]) -> dict[str, str]:
    runs = of_kind(Reaching, plants)
    bands, layers = _deadlines(runs, "band"), _deadlines(runs, "layer")
    return {
        "plants": f"{len(plants):,}",
        "holds": f"{_count(plants, 'holds')}",
        "broken": f"{_count(plants, 'broken')}",
        "nothing": f"{_count(plants, 'nothing promised')}",
        "refused": f"{len(of_kind(RefusedPlant, plants))}",
        "promised_share": f"{100.0 * np.mean([one.promised_fraction for one in runs]):.0f} %",
        "promised_runs": f"{sum(one.promised_fraction > 0.0 for one in runs)}",
        "over": f"{sum(one.excess > 0.0 for one in runs)}",
        "early": f"{sum(np.isfinite(one.early_excess) for one in runs)}",
        "over_alone": f"{sum(one.early_excess > 0.0 for one in runs)}",
        "bands": f"{len(bands)}",
        "late_bands": f"{sum(one.measured > one.promised for one in bands)}",
        "layers": f"{len(layers)}",
        "late_layers": f"{sum(one.measured > one.promised for one in layers)}",
        "tightest": _largest(one.tightness for one in runs),
        "uncovered": f"{sum(one.margin < 0.0 for one in runs)}",
        "slowest": f"{min(one.s_0 for one in runs):.2g}",
        "fastest": f"{max(one.s_0 for one in runs):.2g}",
        "median": _quantile((one.band_ratio for one in runs), 0.5),
        "known_median": _quantile((one.known_ratio for one in runs), 0.5),
        "V_largest": _largest(one.V_tightness for one in runs),
        "used": _largest(one.used for one in runs),
    }


def _of_hunts(hunts: Sequence[Hunt]) -> dict[str, str]:
    return {
        "tries": f"{sum(one.tries for one in hunts):,}",
        "hunts": f"{len(hunts)}",
        "hunts_refused": f"{sum(one.refused == one.tries for one in hunts)}",
        "tries_promised": f"{sum(one.promised for one in hunts):,}",
        "tries_refused": f"{sum(one.refused for one in hunts):,}",
        "tries_broken": f"{sum(one.broken for one in hunts)}",
        "hunted_zero": _largest(one.ratio for one in hunts if not one.reaching),
        "hunted_reaching": _largest(one.ratio for one in hunts if one.reaching),
    }


def _of_outside(away: Sequence[Outside]) -> dict[str, str]:
    gone = [one for one in away if one.over_band > 1.0]
    return {
        "away": f"{len(away)}",
        "away_promised": f"{sum(np.isfinite(one.over_band) for one in away)}",
        "gone": f"{len(gone)}",
        "gone_covered": f"{sum(one.margin >= 0.0 for one in gone)}",
        "first_uncovered": _first(one.scale for one in away if one.margin < 0.0),
        "first_gone": _first(one.scale for one in gone),
        "over_rest": _largest(one.over_rest for one in away),
        "stopped": f"{sum(one.stopped for one in away)}",
    }


def _count(plants: Sequence[DrawnPlant], verdict: str) -> int:
    return sum(one.verdict == verdict for one in plants)


def _deadlines(runs: Sequence[Reaching], name: str) -> list[Deadline]:
    return [one for one in (getattr(run, name) for run in runs) if one is not None]


def _known_of(values: Iterable[float]) -> np.ndarray:
    """Known ones among the values, (N,); inf, for what never came, is one of them."""
    every = np.array(list(values), dtype=float)
    return every[~np.isnan(every)]


def _largest(values: Iterable[float]) -> str:
    known = _known_of(values)
    return f"{known.max():.2f}" if len(known) else "–"


def _quantile(values: Iterable[float], level: float) -> str:
    known = _known_of(values)
    return f"{np.quantile(known, level):.2g}" if len(known) else "–"


def _first(scales: Iterable[float]) -> str:
    known = sorted(scales)
    return f"at {known[0]:g} times the declared distance" if known else "at no distance tried"


def _cells(plants: Sequence[DrawnPlant]) -> Table:
    """Table with one row for each robot, each mode and each kind of bounds."""
    header = (
        "plants", "number", "holds", "broken", "nothing promised", "of these refused", "over (20) alone, early",
        "over (20) + band", "band late", "layer late", "time to the band / promised, median",
        "‖s‖ / ((20) + band), largest", "d − perturbation, least [N]", "perturbation / (d − ε), largest",
    )  # fmt: skip
    kinds = [(robot, [one for one in plants if one.robot == robot]) for robot in ROBOTS]
    kinds += [(mode, [one for one in plants if one.mode == mode]) for mode in MODES]
    kinds += [(f"bounds: {bounds}", [one for one in plants if one.bounds == bounds]) for bounds in BOUNDS]
    return Table(header, [(name, *_row(of)) for name, of in kinds if of])


def _row(of: Sequence[DrawnPlant]) -> tuple[str, ...]:
    runs = of_kind(Reaching, of)
    bands, layers, margins = _deadlines(runs, "band"), _deadlines(runs, "layer"), _known_of(one.margin for one in runs)
    early = sum(np.isfinite(one.early_excess) for one in runs)
    return (
        f"{len(of)}",
        *(f"{_count(of, verdict)}" for verdict in VERDICTS),
        f"{len(of_kind(RefusedPlant, of))}",
        f"{sum(one.early_excess > 0.0 for one in runs)} of {early}",
        f"{sum(one.excess > 0.0 for one in runs)} of {sum(one.promised_fraction > 0.0 for one in runs)}",
        f"{sum(one.measured > one.promised for one in bands)} of {len(bands)}",
        f"{sum(one.measured > one.promised for one in layers)} of {len(layers)}",
        _quantile((one.ratio for one in bands), 0.5),
        _largest(one.tightness for one in runs),
        f"{margins.min():.3g}" if len(margins) else "–",
        _largest(one.used for one in runs),
    )


def _failures(plants: Sequence[DrawnPlant]) -> Table:
    """Table of the runs without a promise throughout, by the premise that failed first."""
    nothing = [one for one in plants if one.verdict == "nothing promised"]

    def why(one: DrawnPlant) -> str:
        return (
            "refused before the start: (17) feeds itself"
            if isinstance(one, RefusedPlant)
            else one.failed or one.stopped
        )

    counted = Counter(map(why, nothing))
    by_bounds = {bounds: Counter(why(one) for one in nothing if one.bounds == bounds) for bounds in BOUNDS}
    rows = [(name, f"{number}", *(f"{by_bounds[b][name]}" for b in BOUNDS)) for name, number in counted.most_common()]
    return Table(("first premise to fail", "runs", *BOUNDS), rows)


def _hunted(hunts: Sequence[Hunt]) -> Table:
    """Table with one row for each robot: the number of the adversary's tries, and the largest ratio that they
    reached."""
    rows = []
    for robot in ROBOTS:
        of = [one for one in hunts if one.robot == robot]
        if of:
            counts = (
                f"{sum(getattr(one, name) for one in of):,}" for name in ("tries", "promised", "refused", "broken")
            )
            most = (_largest(one.ratio for one in of if one.reaching == reaching) for reaching in (False, True))
            rows.append((robot, *counts, *most))
    header = ("robot", "tries", "with a promise", "refused", "broken", "largest ratio, s(0) = 0", "s(0) ≠ 0")
    return Table(header, rows)


def _fractions(plants: Sequence[Reaching]) -> Table:
    """Table of the terms of (17), and the largest share of each that an arm needed."""
    rows = []
    robots = [robot for robot in ROBOTS if any(one.robot == robot and one.promised_fraction > 0.0 for one in plants)]
    for i, (cause, words) in enumerate(CAUSES.items()):
        fractions = (np.nanmean([one.cause_fractions[i] for one in plants if one.robot == robot]) for robot in robots)
        most = _largest(one.used_parts[PARTS.index(cause)] for one in plants) if cause in PARTS else ""
        rows.append((words, *(f"{100 * part:.0f} %" for part in fractions), most))
    return Table(("term of (17)", *robots, "real / bound, largest"), rows)


def _run_chart(shown: Example) -> FigureChart:
    curves = (
        Curve("(20) + sampling band", GREY, shown.t, 1e3 * (shown.bound + shown.band), dashed=True),
        Curve("(20)", GREY, shown.t, 1e3 * shown.bound),
        Curve("band", ORANGE, shown.t, 1e3 * shown.band, dashed=True),
        Curve("‖s‖", BLUE, shown.t, 1e3 * np.maximum(shown.s, 1e-4)),
    )
    return FigureChart("‖s‖ under its bound", "mm/s", curves, logarithmic=True)


def _spread_charts(plants: Sequence[Reaching]) -> Iterable[FigureChart]:
    quantities: dict[str, tuple[str, Callable[[Reaching], float], bool]] = {
        "time to the band": ("measured / promised", lambda one: one.band_ratio, True),
        "time to the band, known afterwards": (
            "measured / promised by the true V(0) and the spare gain",
            lambda one: one.known_ratio,
            True,
        ),
        "sliding variable": ("largest ‖s‖ / ((20) + band)", lambda one: one.tightness, False),
        "gain": ("largest perturbation / (d − ε)", lambda one: one.used, False),
    }
    for title, (x_label, quantity, logarithmic) in quantities.items():
        curves = []
        for robot in ROBOTS:
            values = np.sort(_known_of(quantity(one) for one in plants if one.robot == robot))
            if len(values):
                fraction = 100.0 * np.arange(1, len(values) + 1) / len(values)
                came = np.isfinite(values)  # what never came counts as one of all
                curves.append(Curve(robot, COLORS[robot], values[came], fraction[came]))
        one = Curve("", GREY, np.ones(2), np.array([0.0, 100.0]), dashed=True, listed=False)
        yield FigureChart(title, "% of plants", (*curves, one), x_label=x_label, logarithmic_x=logarithmic)


def _outside_charts(away: Sequence[Outside]) -> Iterable[FigureChart]:
    scales = np.array(SCALES)
    known = [one for one in away if np.isfinite(one.over_band)]
    at = [[one for one in known if one.scale == scale] for scale in SCALES]

    def part(holds: Callable[[Outside], bool]) -> np.ndarray:
        return np.array([100.0 * np.mean([holds(one) for one in of] or [np.nan]) for of in at])

    def quantile(q: float) -> np.ndarray:
        return np.array([np.quantile([one.over_band for one in of] or [np.nan], q) for of in at])

    x_label = "distance from the nominal arm, in declared ones"
    blue, orange = BLUE, ORANGE
    yield FigureChart(
        "runs where something fails", "%",
        (
            Curve("d < perturbation at some instant", orange, scales, part(lambda one: one.margin < 0), dotted=True),
            Curve("‖s‖ over (20) + band", blue, scales, part(lambda one: one.over_band > 1), dotted=True),
        ),
        x_label=x_label, at_least=(0.0, 100.0),
    )  # fmt: skip
    yield FigureChart(
        "largest ‖s‖ / ((20) + band)", "1",
        (
            Curve("95 % of the runs", blue, scales, quantile(0.95), dashed=True),
            Curve("median", blue, scales, quantile(0.5), dotted=True),
            Curve("1", GREY, scales, np.ones(len(scales)), dashed=True, listed=False),
        ),
        x_label=x_label, logarithmic=True,
    )  # fmt: skip


SECTION = EvidenceSection("theorem", jobs, conclude)
