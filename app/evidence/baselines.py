"""Comparison of the unified law with computed torque and PD + gravity, on the same uncertain arms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.analysis.metrics import Account, account
from app.evidence.drawing import charts_in_columns
from app.evidence.section import EvidenceSection, Findings, Job
from app.export.figures import Curve, FigureChart, Rgb
from app.process.markdown import Table
from app.scenario.data import edited, from_plain, shipped, to_plain
from app.scenario.declared_bounds import outside
from app.scenario.schema import Scenario
from app.scenario.units import CARTESIAN
from app.session.headless_run import play
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.system import System

PLANTS, LOT = 100, 10  # number of plants, and of those in a job
DURATION, SETTLED = 4.0, 1.5  # s, length of a run, and instant from which on its metrics count
DECLARED = {
    "link_scaling": 0.15, "payload_mass": 1.0, "payload_offset": 0.05, "coulomb": 0.5, "viscous": 0.3,
    "disturbance": 2.0,
}  # fmt: skip
STIFFER = 5.0  # factor of the frequency
NOISES = (0.0, 0.05, 0.2, 0.5, 1.0)  # N
NOISY_PLANTS = 5


@dataclass(frozen=True)
class Contestant:
    """Contestant: a law with its target model. stiffer: factor of the frequency along the motion-controlled
    coordinates."""

    title: str
    color: Rgb
    law: str
    switching: str = "saturation"
    stiffer: float = 1.0

    def scenario(self) -> Scenario:
        """Scenario: a UR5 that presses with 20 N on 10 kN/m while it draws a circle in 2 s."""
        data = to_plain(shipped()["ur5-hybrid"])
        data["declared"] = dict(DECLARED)
        data["controller"] |= {"law": self.law, "switching": self.switching}
        data["motion"]["period"] = 2.0
        data["simulation"]["duration"] = DURATION
        scenario = from_plain(data)
        model = assemble(scenario).controller.model
        K_m, B_m = np.diag(model.K_m).copy(), np.diag(model.B_m).copy()
        K_m[1:] *= self.stiffer**2
        B_m[1:] *= self.stiffer
        return edited(edited(scenario, "target_model.K_m", K_m.tolist()), "target_model.B_m", B_m.tolist())


CONTESTANTS = (
    Contestant("unified law, layer 10 mm/s", (66, 135, 245), "vsmrc"),
    Contestant("unified law, discontinuous", (204, 121, 167), "vsmrc", switching="discontinuous"),
    Contestant("computed torque", (230, 159, 0), "computed-torque"),
    Contestant("computed torque, 5 × as fast", (180, 100, 0), "computed-torque", stiffer=STIFFER),
    Contestant("PD + gravity", (0, 158, 115), "pd-gravity"),
    Contestant("PD + gravity, 5 × as fast", (0, 110, 60), "pd-gravity", stiffer=STIFFER),
)


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run.
    account: from `SETTLED` on.
    over_bound: largest excess of ||s|| over (20) with its band where they are promised, m/s; None where they never are.
    promised: share of the control periods in which they are.
    stopped: reason for which the run ended early, None for none."""

    account: Account
    over_bound: float | None
    promised: float
    stopped: str | None


def uncertain(scenario: Scenario, seed: int) -> Scenario:
    """The scenario with a random true arm of the declared set, with one link in three at its edge."""
    random, n = np.random.default_rng(seed), 6
    offset = random.standard_normal(3)
    offset *= DECLARED["payload_offset"] * random.uniform() / np.linalg.norm(offset)
    fractions = {name: random.uniform() for name in ("payload_mass", "coulomb", "viscous", "disturbance")}
    data = to_plain(scenario)
    data["truth"] = {
        "link_scaling": (1.0 + DECLARED["link_scaling"] * np.clip(random.uniform(-1.5, 1.5, n), -1, 1)).tolist(),
        "payload_offset": offset.tolist(),
        **{name: DECLARED[name] * part for name, part in fractions.items()},
    }
    changed = from_plain(data)
    assert not outside(changed, CARTESIAN), "the plants are those that the controller was told of"
    return changed


def _run(scenario: Scenario, previous: System | None) -> tuple[Outcome, System]:
    loop = ClosedLoop.from_scenario(scenario, previous=previous)
    play(loop, round(scenario.simulation.duration / loop.period))
    counted = account(loop.system, loop.recording, SETTLED, loop.t)
    if counted is None:
        raise RuntimeError(f"{scenario.name}: {loop.stopped}")
    s = loop.recording.signals(("s_norm", "s_bound", "s_band"))
    over_bound, promised = _beyond(s["s_norm"] - s["s_bound"] - s["s_band"])
    return Outcome(counted, over_bound, promised, loop.stopped), loop.system


def _beyond(excess: np.ndarray) -> tuple[float | None, float]:
    """Largest of the excesses that are promised not to be, None for none, and their share; the others are NaN."""
    promised = np.isfinite(excess)
    return (float(excess[promised].max()) if promised.any() else None), float(promised.mean())


def on_uncertain(contestant: Contestant, seeds: Sequence[int], noise: float) -> list[Outcome]:
    """Outcomes with a random arm for each seed. noise: of the force sensor, N per axis."""
    base, outcomes, system = contestant.scenario(), [], None
    for seed in seeds:
        scenario = edited(edited(uncertain(base, seed), "sensor.noise", noise), "simulation.seed", seed)
        if noise > 0.0:
            scenario = edited(scenario, "declared.force_error", 4.0 * noise)
        outcome, system = _run(scenario, system)
        outcomes.append(outcome)
    return outcomes


def on_exact(contestant: Contestant) -> Outcome:
    """Outcome with a true arm that is exactly the nominal one, under the same declared bounds."""
    return _run(edited(contestant.scenario(), "truth.link_scaling", 1.0), None)[0]


def jobs(thin: int) -> list[Job]:
    plants = max(4, PLANTS // thin)
    lots = [tuple(range(first, min(first + LOT, plants))) for first in range(0, plants, LOT)]
    noisy = tuple(range(max(1, NOISY_PLANTS // thin)))
    return [
        *(Job(on_uncertain, (who, lot, 0.0)) for who in CONTESTANTS for lot in lots),
        *(Job(on_exact, (who,)) for who in CONTESTANTS),
        *(Job(on_uncertain, (who, noisy, noise)) for who in CONTESTANTS for noise in NOISES),
    ]


def conclude(results: Sequence[list[Outcome] | Outcome]) -> Findings:
    found = iter(results)
    count = len(results) // len(CONTESTANTS) - 1 - len(NOISES)  # lots
    main: dict[Contestant, list[Outcome]] = {}
    for who in CONTESTANTS:
        main[who] = [outcome for _ in range(count) for outcome in _listed(next(found))]
    exact = {who: _listed(next(found))[0] for who in CONTESTANTS}
    noisy = {who: [_listed(next(found)) for _ in NOISES] for who in CONTESTANTS}
    robust = [outcome for who in CONTESTANTS[:2] for outcome in main[who]]
    excesses = [outcome.over_bound for outcome in robust if outcome.over_bound is not None]
    path = {who: float(np.median([o.account.path_rms or 0.0 for o in main[who]])) for who in CONTESTANTS}
    force = {who: float(np.median([o.account.force_rms or 0.0 for o in main[who]])) for who in CONTESTANTS}
    ours, _, computed, fast, *_ = CONTESTANTS
    return Findings(
        numbers={
            "plants": str(len(main[ours])),
            "violations": str(sum(excess > 1e-9 for excess in excesses)),
            "judged_runs": str(len(excesses)),
            **{
                f"promised_{name}": _percent(main[who]) for name, who in zip(("layer", "switching"), main, strict=False)
            },
            "robust_runs": str(len(robust)),
            "path_gain": f"{path[computed] / path[ours]:.0f}",
            "path_gain_fast": f"{path[fast] / path[ours]:.1f}",
            "force_gain": f"{force[computed] / force[ours]:.0f}",
            "noisy_plants": str(len(noisy[ours][-1])),
            "noise_ratio": f"{_variation(noisy[ours][-1]) / _variation(noisy[computed][-1]):.1f}",
            "exact_computed": f"{1e3 * (exact[fast].account.path_rms or 0.0):.2g}",
            "exact_ours": f"{1e3 * (exact[ours].account.path_rms or 0.0):.2g}",
            "loudest": f"{NOISES[-1]:g}",
        },
        tables={"uncertain": _table(main), "exact": _exact_table(exact), "noise": _noise_table(noisy)},
        figures={"plants": _figure(main, noisy)},
    )


def _percent(outcomes: Sequence[Outcome]) -> str:
    """Share of the control periods of these runs in which (20) is promised, in percent."""
    return f"{100.0 * float(np.mean([outcome.promised for outcome in outcomes])):.3g}"


def _variation(outcomes: Sequence[Outcome]) -> float:
    return float(np.median([outcome.account.variation for outcome in outcomes]))


def _listed(result: list[Outcome] | Outcome) -> list[Outcome]:
    return result if isinstance(result, list) else [result]


def _of(outcomes: Sequence[Outcome]) -> dict[str, np.ndarray]:
    """Metrics of runs, in the units in which they are shown."""
    of = [outcome.account for outcome in outcomes]
    return {
        "path": np.array([1e3 * (each.path_rms or 0.0) for each in of]),
        "force": np.array([each.force_rms or 0.0 for each in of]),
        "effort": np.array([each.effort for each in of]),
        "variation": np.array([each.variation for each in of]),
    }


def _table(main: dict[Contestant, list[Outcome]]) -> Table:
    header = (
        "median / worst of the plants",
        "path error, RMS [mm]",
        "force error, RMS [N]",
        "torque ‖τ‖, RMS [N·m]",
        "torque variation [N·m/s]",
        "stopped",
    )
    rows = []
    for who, outcomes in main.items():
        cells = (f"{np.median(values):.3g} / {values.max():.3g}" for values in _of(outcomes).values())
        rows.append((who.title, *cells, str(sum(outcome.stopped is not None for outcome in outcomes))))
    return Table(header, rows)


def _exact_table(exact: dict[Contestant, Outcome]) -> Table:
    header = (
        "the arm exactly as believed",
        "path error, RMS [mm]",
        "force error, RMS [N]",
        "torque ‖τ‖, RMS [N·m]",
        "torque variation [N·m/s]",
    )
    rows = [
        (who.title, *(f"{float(values[0]):.3g}" for values in _of([outcome]).values()))
        for who, outcome in exact.items()
    ]
    return Table(header, rows)


def _noise_table(noisy: dict[Contestant, list[list[Outcome]]]) -> Table:
    header = ("force error RMS [N] / variation [N·m/s], medians", *(f"σ = {noise:g} N" for noise in NOISES))
    rows = []
    for who, of_noise in noisy.items():
        medians = [{name: float(np.median(v)) for name, v in _of(outcomes).items()} for outcomes in of_noise]
        rows.append((who.title, *(f"{m['force']:.3g} / {m['variation']:.3g}" for m in medians)))
    return Table(header, rows)


def _figure(main: dict[Contestant, list[Outcome]], noisy: dict[Contestant, list[list[Outcome]]]) -> bytes:
    def over_plants(name: str) -> tuple[Curve, ...]:
        rank = np.arange(1.0, len(main[CONTESTANTS[0]]) + 1.0)
        return tuple(_curve(who, rank, np.sort(_of(runs)[name]), listed=name == "path") for who, runs in main.items())

    def over_noise(name: str) -> tuple[Curve, ...]:
        medians = {who: np.array([np.median(_of(runs)[name]) for runs in of]) for who, of in noisy.items()}
        return tuple(_curve(who, np.array(NOISES), y, listed=name == "force") for who, y in medians.items())

    rank, sigma = "plants, from the best to the worst", "noise of the force sensor, σ per axis [N]"
    charts = (
        FigureChart("path error, RMS", "mm", over_plants("path"), x_label=rank, logarithmic=True),
        FigureChart("force error, RMS", "N", over_plants("force"), x_label=rank, logarithmic=True),
        FigureChart("variation of the torque", "N·m/s", over_plants("variation"), x_label=rank, logarithmic=True),
        FigureChart("force error, RMS, against noise", "N", over_noise("force"), x_label=sigma, logarithmic=True),
        FigureChart(
            "variation of the torque, against noise", "N·m/s", over_noise("variation"), x_label=sigma, logarithmic=True
        ),
    )
    count = len(next(iter(noisy.values()))[0])
    return charts_in_columns(
        charts, f"Left: each law's runs in the order of its own figure. Right: medians of the first {count} plants."
    )


def _curve(who: Contestant, x: np.ndarray, y: np.ndarray, *, listed: bool) -> Curve:
    return Curve(who.title, who.color, x, y, dashed=who.stiffer > 1.0, listed=listed)


SECTION = EvidenceSection("baselines", jobs, conclude)
