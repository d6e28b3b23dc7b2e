"""Theorem 1 on random arms: reaching (18), (20) and (24), the gain (17), and what happens outside the declared set."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from app.closed_loop import ClosedLoop
from app.evidence.drawing import charts_in_columns
from app.evidence.plants import Departure, drawn, random_of, situation, with_gains
from app.evidence.section import Findings, Job, Section
from app.figures import Chart, Curve
from app.headless import simulate
from app.hindsight import Hindsight
from app.markdown import Table
from app.scenario import Scenario
from app.scenario_data import edited

ROBOTS = ("ur5", "panda", "planar2r", "planar3r")
MODES = ("motion", "impedance", "hybrid", "hybrid-impedance", "constrained")
RIGID = "constrained"
SITUATIONS, PLANTS = 5, 10  # of each robot in each mode, and plants in each: 1,000 in all
LOOKS = 12  # instants of each run while s is reached, and as many later, at which the true arm is looked at

SCALES = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0)
OUTSIDE_ROBOTS = ("ur5", "planar3r")
OUTSIDE = 3  # situations of each robot in each mode, with a plant each

CAUSES = ("inertia", "Coriolis", "gravity", "moving task", "disturbance", "ε")  # of the signal `needed`
PARTS = {"inertia": 0, "coriolis": 1, "gravity": 2, "disturbance": 4}  # of the perturbation, by their cause
COLORS = dict(zip(ROBOTS, ((66, 135, 245), (230, 159, 0), (0, 158, 115), (204, 121, 167)), strict=True))
GREY = (120, 120, 120)


@dataclass(frozen=True)
class Reaching:
    """One run.

    s_0: ||s|| at the start, m/s; excess: of ||s|| beyond (20) and the band, m/s; early_excess: beyond (20) alone until
    the band is reached; tightness: largest ||s|| over (20) with band; V_tightness: largest V over (24) meanwhile;
    promised: t_r of (18), s; known: the same from the true V(0), and the least that d had to spare in place of epsilon;
    measured: when the band was reached, nan for never; began_outside: the band; margin: least d - perturbation, N;
    used: largest perturbation over d - epsilon; shares (6,): mean share of each cause in (17); used_parts (4,): largest
    part of the perturbation over its bound; left: why it is no case of the theorem, None when it is one; lagging: the
    multiplier is read one period late.
    """

    robot: str
    mode: str
    s_0: float
    excess: float
    early_excess: float
    tightness: float
    V_tightness: float
    promised: float
    known: float
    measured: float
    began_outside: bool
    margin: float
    used: float
    shares: np.ndarray
    used_parts: np.ndarray
    left: str | None
    lagging: bool


@dataclass(frozen=True)
class Outside:
    """One run of an arm `scale` times as far away as declared, from s(0) = 0 on: largest ||s|| over its band, and over
    what (23) leaves of the promise; least margin d - perturbation, N."""

    scale: float
    over_band: float
    over_rest: float
    margin: float
    stopped: bool


@dataclass(frozen=True)
class Example:
    """||s||, its bound (20) and the sampling band, (N,) m/s, over t (N,) s."""

    t: np.ndarray
    s: np.ndarray
    bound: np.ndarray
    band: np.ndarray


Outcome = list[Reaching] | list[Outside]


def reach(robot: str, mode: str, seed: int) -> list[Reaching]:
    """The plants of one situation."""
    return _reached([drawn(robot, mode, seed, number) for number in range(PLANTS)])


def lag(robot: str) -> list[Reaching]:
    """The plants of one situation on a rigid surface, where the multiplier is read one period late."""
    return _reached([edited(drawn(robot, RIGID, 0, number), "sensor.ideal", False) for number in range(PLANTS)])


def _reached(scenarios: Sequence[Scenario]) -> list[Reaching]:
    found, previous = [], None
    for scenario in scenarios:
        loop, _ = simulate(scenario, previous=previous)
        previous = loop.system
        found.append(_reaching(loop))
    return found


def _reaching(loop: ClosedLoop) -> Reaching:
    record = loop.recording.signals(tuple(loop.recording.columns))
    t, s, bound, band = (record[name] for name in ("t", "s_norm", "s_bound", "s_band"))
    measured = np.nan if loop.reaching_time is None else loop.reaching_time
    early = t < (np.inf if np.isnan(measured) else measured)
    last = int(early.sum())
    looks = np.unique(np.linspace([0, last], [max(last - 1, 0), len(t) - 1], LOOKS).astype(int))
    known = Hindsight(loop.system).recorded(record, tuple(loop.recording.epochs), looks)
    real, d, epsilon = known["perturbation"][looks], record["d"][looks], loop.system.law.epsilon
    margin = d - real
    c, V, V_bound = loop.certificate, known["V"][looks], known["V_bound"][looks]
    reaching = looks < last
    spare = float(margin[reaching].min()) if reaching.any() else epsilon
    hindsight = replace(c, epsilon=max(spare, epsilon), V_0=float(V[0]))
    needed = record["needed"][looks]
    parts = np.stack([known[name][looks] for name in PARTS])
    bounds = needed[:, list(PARTS.values())].T  # both are zero for Coriolis forces at rest
    inside = all(loop.system.constants.holds_at(q) for q in record["q"][looks])
    return Reaching(
        robot=loop.system.scenario.robot.name,
        mode=loop.system.mode.name,
        s_0=float(s[0]),
        excess=float((s - bound - band).max()),
        early_excess=float((s - bound)[early].max(initial=-np.inf)),
        tightness=float((s / (bound + band)).max()),
        V_tightness=float((V[reaching] / V_bound[reaching]).max(initial=0.0)),
        promised=c.t_r,
        known=hindsight.t_r,
        measured=measured,
        began_outside=bool(early.any()),
        margin=float(margin.min()),
        used=float((real / (d - epsilon)).max()),
        shares=(needed / needed.sum(axis=1, keepdims=True)).mean(axis=0),
        used_parts=np.divide(parts, bounds, out=np.zeros_like(parts), where=bounds > 0.0).max(axis=1),
        left=loop.stopped or (None if inside else "q has left Ω"),
        lagging=loop.system.plant.kind == "rigid" and not loop.system.scenario.sensor.ideal,
    )


def outside(robot: str, mode: str, seed: int) -> list[Outside]:
    """One corner of the declared set, moved away from the nominal arm step by step."""
    here = edited(situation(robot, mode, seed), "controller.on_change", "remove")
    random, found, previous = random_of(robot, mode, seed, PLANTS), [], None
    departure = Departure.edge(random, len(here.robot.posture or ()))
    here = with_gains(here, random)
    for scale in SCALES:
        scenario = msgspec.structs.replace(here, truth=departure.truth(here.declared, scale))
        loop, _ = simulate(scenario, previous=previous)
        previous = loop.system
        found.append(_outside(loop, scale))
    return found


def _outside(loop: ClosedLoop, scale: float) -> Outside:
    record = loop.recording.signals(tuple(loop.recording.columns))
    looks = np.linspace(0, len(record["t"]) - 1, 4 * LOOKS).astype(int)
    known = Hindsight(loop.system).recorded(record, tuple(loop.recording.epochs), looks)
    margin = float((record["d"][looks] - known["perturbation"][looks]).min())
    s, band, c = record["s_norm"], record["s_band"], loop.certificate
    rest = np.sqrt(c.k_r_high / c.k_r_low) * max(-margin, 0.0) / c.lambda_min_K_s
    return Outside(scale, float((s / band).max()), float((s / (band + rest)).max()), margin, loop.stopped is not None)


def example() -> Example:
    """One run to look at."""
    loop, _ = simulate(drawn("ur5", "hybrid", 0, 0))
    few = slice(None, None, 5)
    signals = loop.recording.signals(("t", "s_norm", "s_bound", "s_band"))
    return Example(*(values[few] for values in signals.values()))


def jobs(thin: int) -> list[Job]:
    cells = [(robot, mode, seed) for seed in range(SITUATIONS) for robot in ROBOTS for mode in MODES]
    away = [(robot, mode, seed) for seed in range(OUTSIDE) for robot in OUTSIDE_ROBOTS for mode in MODES]
    mixed = np.random.default_rng(0)  # so that a few of the cells are of all kinds
    mixed.shuffle(cells)
    mixed.shuffle(away)
    return [
        Job(example),
        *(Job(reach, cell) for cell in cells[::thin]),
        *(Job(lag, (robot,)) for robot in ROBOTS[::thin]),
        *(Job(outside, cell) for cell in away[::thin]),
    ]


def conclude(results: Sequence[Example | Outcome]) -> Findings:
    shown = next(result for result in results if isinstance(result, Example))
    batches = [result for result in results if isinstance(result, list)]
    plants = [one for batch in batches for one in batch if isinstance(one, Reaching)]
    late = [one for one in plants if one.lagging]
    plants = [one for one in plants if not one.lagging]
    away = [one for batch in batches for one in batch if isinstance(one, Outside)]
    ratio = np.array([one.measured / one.promised for one in plants])
    broken = [one for one in away if one.over_band > 1.0]
    numbers = {
        "plants": f"{len(plants):,}",
        "over": f"{sum(one.excess > 0.0 for one in plants)}",
        "over_alone": f"{sum(one.early_excess > 0.0 for one in plants)}",
        "late": f"{sum(not one.measured <= one.promised for one in plants)}",
        "uncovered": f"{sum(one.margin < 0.0 for one in plants)}",
        "left": f"{sum(one.left is not None for one in plants)}",
        "began": f"{sum(one.began_outside for one in plants)}",
        "slowest": f"{min(one.s_0 for one in plants):.2g}",
        "fastest": f"{max(one.s_0 for one in plants):.2g}",
        "median": f"{np.median(ratio):.2g}",
        "known_median": f"{np.median([one.measured / one.known for one in plants]):.2g}",
        "V_largest": f"{max(one.V_tightness for one in plants):.2f}",
        "used": f"{max(one.used for one in plants):.2f}",
        "lag_plants": f"{len(late)}",
        "lag_over": f"{sum(one.excess > 0.0 for one in late)}",
        "lag_uncovered": f"{sum(one.margin < 0.0 for one in late)}",
        "lag_used": f"{max(one.used for one in late):.2g}",
        "away": f"{len(away)}",
        "broken": f"{len(broken)}",
        "broken_covered": f"{sum(one.margin >= 0.0 for one in broken)}",
        "first_uncovered": f"{min((one.scale for one in away if one.margin < 0.0), default=np.nan):g}",
        "first_broken": f"{min((one.scale for one in broken), default=np.nan):g}",
        "over_rest": f"{max(one.over_rest for one in away):.2f}",
        "stopped": f"{sum(one.stopped for one in away)}",
    }
    figures = {
        "example": charts_in_columns(
            (_run_chart(shown),), "A UR5 that presses, first of its plants: drawn('ur5', 'hybrid', 0, 0)."
        ),
        "spread": charts_in_columns(
            _spread_charts(plants), "Share of the plants that stay below the value on the axis."
        ),
        "outside": charts_in_columns(
            _outside_charts(away), "Corners of the declared set moved away from the nominal arm."
        ),
    }
    return Findings(
        numbers=numbers,
        tables={"cells": _cells(plants), "shares": _shares(plants)},
        figures=figures,
    )


def _cells(plants: Sequence[Reaching]) -> Table:
    """One row for each robot, and one for each mode."""
    header = (
        "plants", "number", "over (20) + band", "t_r missed", "t_r / (18), median", "its 95 %", "‖s‖ / bound, largest",
        "V / (24), largest", "d − perturbation, least [N]", "perturbation / (d − ε), largest",
    )  # fmt: skip
    kinds = [(robot, [one for one in plants if one.robot == robot]) for robot in ROBOTS]
    kinds += [(mode, [one for one in plants if one.mode == mode]) for mode in MODES]
    return Table(header, [(name, *_row(of)) for name, of in kinds if of])


def _row(of: Sequence[Reaching]) -> tuple[str, ...]:
    ratio = np.array([one.measured / one.promised for one in of])
    return (
        f"{len(of)}",
        f"{sum(one.excess > 0.0 for one in of)}",
        f"{sum(not one.measured <= one.promised for one in of)}",
        f"{np.median(ratio):.2g}",
        f"{np.quantile(ratio, 0.95):.2g}",
        f"{max(one.tightness for one in of):.2f}",
        f"{max(one.V_tightness for one in of):.2f}",
        f"{min(one.margin for one in of):.3g}",
        f"{max(one.used for one in of):.2f}",
    )


def _shares(plants: Sequence[Reaching]) -> Table:
    """What (17) is made of, and how much of each part an arm really used."""
    rows = []
    used = {cause: number for number, cause in enumerate(PARTS.values())}
    robots = [robot for robot in ROBOTS if any(one.robot == robot for one in plants)]
    for cause, name in enumerate(CAUSES):
        share = (np.mean([one.shares[cause] for one in plants if one.robot == robot]) for robot in robots)
        most = f"{max(one.used_parts[used[cause]] for one in plants):.2f}" if cause in used else ""
        rows.append((name, *(f"{100 * part:.0f} %" for part in share), most))
    return Table(("term of (17)", *robots, "real / bound, largest"), rows)


def _run_chart(shown: Example) -> Chart:
    curves = (
        Curve("(20) + sampling band", GREY, shown.t, 1e3 * (shown.bound + shown.band), dashed=True),
        Curve("(20)", GREY, shown.t, 1e3 * shown.bound),
        Curve("band", COLORS["panda"], shown.t, 1e3 * shown.band, dashed=True),
        Curve("‖s‖", COLORS["ur5"], shown.t, 1e3 * np.maximum(shown.s, 1e-4)),
    )
    return Chart("‖s‖ under its bound", "mm/s", curves, logarithmic=True)


def _spread_charts(plants: Sequence[Reaching]) -> Iterable[Chart]:
    quantities: dict[str, tuple[str, Callable[[Reaching], float], bool]] = {
        "reaching time": ("measured / (18)", lambda one: one.measured / one.promised, True),
        "reaching time, with hindsight": (
            "measured / (18) from the true V(0) and the spare gain",
            lambda one: one.measured / one.known,
            True,
        ),
        "sliding variable": ("largest ‖s‖ / ((20) + band)", lambda one: one.tightness, False),
        "gain": ("largest perturbation / (d − ε)", lambda one: one.used, False),
    }
    for title, (x_label, quantity, logarithmic) in quantities.items():
        curves = []
        for robot in ROBOTS:
            values = np.sort([quantity(one) for one in plants if one.robot == robot])
            if len(values):
                share = 100.0 * np.arange(1, len(values) + 1) / len(values)
                curves.append(Curve(robot, COLORS[robot], values, share))
        one = Curve("", GREY, np.ones(2), np.array([0.0, 100.0]), dashed=True, listed=False)
        yield Chart(title, "% of plants", (*curves, one), x_label=x_label, logarithmic_x=logarithmic)


def _outside_charts(away: Sequence[Outside]) -> Iterable[Chart]:
    scales = np.array(SCALES)
    at = [[one for one in away if one.scale == scale] for scale in SCALES]

    def share(holds: Callable[[Outside], bool]) -> np.ndarray:
        return np.array([100.0 * np.mean([holds(one) for one in of]) for of in at])

    def quantile(q: float) -> np.ndarray:
        return np.array([np.quantile([one.over_band for one in of], q) for of in at])

    x_label = "distance from the nominal arm, in declared ones"
    blue, orange = COLORS["ur5"], COLORS["panda"]
    yield Chart(
        "runs where something fails", "%",
        (
            Curve("d < perturbation at some instant", orange, scales, share(lambda one: one.margin < 0), dotted=True),
            Curve("‖s‖ leaves its band", blue, scales, share(lambda one: one.over_band > 1), dotted=True),
        ),
        x_label=x_label, at_least=(0.0, 100.0),
    )  # fmt: skip
    yield Chart(
        "largest ‖s‖ / band", "1",
        (
            Curve("95 % of the runs", blue, scales, quantile(0.95), dashed=True),
            Curve("median", blue, scales, quantile(0.5), dotted=True),
            Curve("1", GREY, scales, np.ones(len(scales)), dashed=True, listed=False),
        ),
        x_label=x_label, logarithmic=True,
    )  # fmt: skip


SECTION = Section("theorem", jobs, conclude)
