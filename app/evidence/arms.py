"""Runs of random arms: the promise for each, whether it is kept, and quantities that only the simulation knows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import msgspec
import numpy as np

from app.analysis.perturbation import PARTS, PerturbationAnalysis
from app.evidence.plants import (
    built,
    drawn,
    largest_ratio,
    later_rows,
    random_of,
    run,
    situation,
    with_arm_of,
    with_gains,
)
from app.scenario.data import edited
from app.scenario.departures import Departure
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.simulation.closed_loop import ClosedLoop
from controllers.bounds import CAUSES

RIGID = "constrained"
PLANTS = 5  # in each situation
LOOKS = 12  # instants of each run before the band is reached, and as many later, at which the true arm is examined
SCALES = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0)


@dataclass(frozen=True)
class Deadline:
    """Deadline: a promised time, s after the beginning of the run, and the measured one, infinite for never."""

    promised: float
    measured: float

    @property
    def ratio(self) -> float:
        """Ratio of the measured time to the promised one."""
        return self.measured / self.promised


@dataclass(frozen=True)
class DrawnPlant:
    """Plant of a run, drawn inside the declared set, and the verdict on its promise.
    bounds: kind of the declared bounds.
    lagging: whether the multiplier is read one period late.
    failed: title of the premise that failed first, "" for none.
    stopped: reason for which the run ended early, "" for none."""

    robot: str
    mode: str
    bounds: str
    lagging: bool
    verdict: str
    failed: str = ""
    stopped: str = ""


@dataclass(frozen=True)
class RefusedPlant(DrawnPlant):
    """Plant that does not start, since the feedback of its gain (17) to itself is too large."""


@dataclass(frozen=True)
class Reaching(DrawnPlant):
    """Reaching of one run; all metrics count only periods with a promise, and are nan where there are none.

    s_0: ||s|| at the start, m/s.
    promised_fraction: of the run's periods that have a promise.
    excess: largest excess of ||s|| over (20) with the band, m/s.
    early_excess: largest excess of ||s|| over (20) alone until the band is reached, m/s, nan where s began in the band.
    tightness: largest ||s|| over (20) with the band, after the first row of each promise.
    V_tightness: largest V over (24) until the band is reached.
    layer, band: deadlines for both, None where a premise failed before, or there was nothing to reach.
    known: time to the band, s, that the theorem would promise with the true V(0), and with the least true margin of d
    in place of epsilon.
    margin: least d - perturbation, N.
    used: largest perturbation over d - epsilon.
    cause_fractions: (6,), mean fraction of each cause in (17).
    used_parts: (4,), largest part of the perturbation over its bound.
    """

    s_0: float = np.nan
    promised_fraction: float = 0.0
    excess: float = np.nan
    early_excess: float = np.nan
    tightness: float = np.nan
    V_tightness: float = np.nan
    layer: Deadline | None = None
    band: Deadline | None = None
    known: float = np.nan
    margin: float = np.nan
    used: float = np.nan
    cause_fractions: np.ndarray = field(default_factory=lambda: np.full(len(CAUSES), np.nan))
    used_parts: np.ndarray = field(default_factory=lambda: np.full(len(PARTS), np.nan))

    @property
    def band_ratio(self) -> float:
        """Ratio of the time to the band to the promised one."""
        return np.nan if self.band is None else self.band.ratio

    @property
    def known_ratio(self) -> float:
        """Ratio of the time to the band to the time `known`."""
        return np.nan if self.band is None or not self.known > 0.0 else self.band.measured / self.known


@dataclass(frozen=True)
class Outside:
    """Run of an arm outside of the declared set, from s(0) = 0 on, judged as if the arm were inside. All metrics count
    the periods in which all other premises hold, and are nan without any.
    scale: distance of the true arm from the nominal one over the declared distance.
    over_band: largest ||s|| over (20) with its band; s(0) = 0.
    over_rest: largest ||s|| over its band plus the rest that (23) leaves with the margin.
    margin: least d - perturbation, N."""

    scale: float
    over_band: float
    over_rest: float
    margin: float
    stopped: bool


@dataclass(frozen=True)
class Example:
    """Example for a figure: t (N,) s; ||s||, its bound (20) and the sampling band, (N,) m/s each."""

    t: np.ndarray
    s: np.ndarray
    bound: np.ndarray
    band: np.ndarray


def reach(robot: str, mode: str, seed: int) -> list[DrawnPlant]:
    """Plants of one situation."""
    return _reached([drawn(robot, mode, seed, number) for number in range(PLANTS)], lagging=False)


def lag(robot: str) -> list[DrawnPlant]:
    """Plants of one situation on a rigid surface, where the multiplier is read one period late."""
    late = [edited(drawn(robot, RIGID, 0, number), "sensor.ideal", False) for number in range(PLANTS)]
    return _reached(late, lagging=True)


def _reached(scenarios: Sequence[Scenario], *, lagging: bool) -> list[DrawnPlant]:
    found: list[DrawnPlant] = []
    previous = None
    for scenario in scenarios:
        about = scenario.robot.name, scenario.mode, scenario.controller.bounds, lagging
        previous = built(scenario, previous)
        try:
            found.append(_reaching(run(previous), DrawnPlant(*about, "nothing promised")))
        except ScenarioError as error:
            if not str(error).startswith("controller.bounds"):
                raise
            found.append(RefusedPlant(*about, "nothing promised"))
    return found


def _reaching(loop: ClosedLoop, about: DrawnPlant) -> Reaching:
    record = loop.recording.signals(tuple(loop.recording.columns))
    s, limit = record["s_norm"], record["s_bound"] + record["s_band"]
    promised = np.isfinite(limit)
    standing = loop.standing
    first = min(
        (f for f in standing.findings_of_run if f.failed is not None), key=lambda f: f.failed or 0.0, default=None
    )
    judged = replace(
        about, verdict=standing.run.verdict, failed=first.title if first else "", stopped=loop.stopped or ""
    )
    found = Reaching(**vars(judged), s_0=float(s[0]), promised_fraction=float(promised.mean()))
    if not promised.any():
        return found
    early = _before_band(record, promised)
    until = np.inf if first is None or first.failed is None else first.failed
    epoch = loop.recording.epochs[0]
    has_layer = loop.system.controller.has_layer
    found = replace(
        found,
        excess=float((s - limit)[later].max()) if (later := later_rows(promised)).any() else np.nan,
        early_excess=float((s - record["s_bound"])[early].max()) if early.any() else np.nan,
        tightness=largest_ratio(record),
        layer=_deadline(epoch.layer_reached_by, epoch.layer_reached, until, loop.t) if has_layer else None,
        band=_deadline(epoch.band_reached_by, epoch.band_reached, until, loop.t),
    )
    return _with_true_perturbation(found, loop, record, promised, early)


def _before_band(record: Mapping[str, np.ndarray], promised: np.ndarray) -> np.ndarray:
    """Mask (N,) of the rows with a promise, but for the first row of each, that come before ||s|| is first within the
    band since that promise began."""
    early, reached = promised.copy(), False
    for i in range(len(promised)):
        reached = promised[i] and (reached or record["s_norm"][i] <= record["s_band"][i])
        early[i] &= not reached
    return early & later_rows(promised)


def _deadline(promised: float | None, measured: float | None, until: float, end: float) -> Deadline | None:
    """Deadline of a promised and a measured time, s; None where there was no promise, where it was met from the
    beginning, where a premise failed before it (`until`, s), or where the run ended before it (`end`, s)."""
    if promised is None or measured == 0.0 or promised <= 0.0 or promised >= until:
        return None
    if measured is None and promised > end:
        return None
    return Deadline(promised, np.inf if measured is None else measured)


def _with_true_perturbation(
    found: Reaching, loop: ClosedLoop, record: Mapping[str, np.ndarray], promised: np.ndarray, early: np.ndarray
) -> Reaching:
    """Reaching with the metrics that only the simulation can know: those from V and from the perturbation."""
    looks = np.unique(np.concatenate([_some(np.flatnonzero(early)), _some(np.flatnonzero(promised & ~early))]))
    known = PerturbationAnalysis(loop.system).recorded(record, tuple(loop.recording.epochs), looks)
    real, d, epsilon = known["perturbation"][looks], record["d"][looks], loop.system.controller.epsilon
    V, V_bound, reaching = known["V"][looks], known["V_bound"][looks], early[looks]
    time = np.nan
    if found.band is not None and reaching.any():
        spare = max(float((d - real)[reaching].min()), epsilon)
        last = int(np.searchsorted(record["t"], min(found.band.measured, record["t"][-1])))
        begun = replace(loop.recording.epochs[0].certificate, epsilon=spare, V_0=float(V[0]))
        time = begun.time_to(float(np.nanmin(record["s_band"][: last + 1])))
    needed = record["needed"][looks]
    terms = dict(zip(CAUSES, needed.T, strict=True))
    terms["inertia"] = terms["inertia"] + terms["task_motion"]  # (7) has two bounds for the one term M q_eq_ddot
    parts = np.stack([known[cause][looks] for cause in PARTS])
    bounds = np.stack([terms[cause] for cause in PARTS])  # at rest, part and bound of the Coriolis forces are zero
    return replace(
        found,
        V_tightness=float((V[reaching] / V_bound[reaching]).max(initial=0.0)) if reaching.any() else np.nan,
        known=time,
        margin=float((d - real).min()),
        used=float((real / (d - epsilon)).max()),
        cause_fractions=(needed / needed.sum(axis=1, keepdims=True)).mean(axis=0),
        used_parts=np.divide(parts, bounds, out=np.zeros_like(parts), where=bounds > 0.0).max(axis=1),
    )


def _some(rows: np.ndarray) -> np.ndarray:
    """At most `LOOKS` of the rows, first and last included."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, LOOKS).astype(int))] if len(rows) else rows


def outside(robot: str, mode: str, seed: int) -> list[Outside]:
    """Runs of arms in the direction of one corner of the declared set, farther and farther from the nominal arm."""
    here = edited(situation(robot, mode, seed), "controller.on_change", "remove")
    random = random_of(robot, mode, seed, PLANTS)
    departure = Departure.edge(random, len(here.robot.posture or ()))
    inside = msgspec.structs.replace(with_gains(here, random), truth=departure.truth(here.declared))
    believed = built(inside)
    found = []
    for scale in SCALES:
        scenario = msgspec.structs.replace(inside, truth=departure.truth(here.declared, scale))
        found.append(_outside(run(with_arm_of(scenario, believed)), scenario, scale))
    return found


def _outside(loop: ClosedLoop, scenario: Scenario, scale: float) -> Outside:
    """Metrics of a loop that takes its arm for one inside the declared set, so that it still judges the other premises
    and the band."""
    record = loop.recording.signals(tuple(loop.recording.columns))
    limit = record["s_bound"] + record["s_band"]
    promised = np.flatnonzero(np.isfinite(limit))
    if not len(promised):
        return Outside(scale, np.nan, np.nan, np.nan, loop.stopped is not None)
    looks = promised[np.unique(np.linspace(0, len(promised) - 1, 4 * LOOKS).astype(int))]
    epochs = [replace(epoch, scenario=scenario) for epoch in loop.recording.epochs]  # with the true arm
    known = PerturbationAnalysis(loop.system).recorded(record, epochs, looks)
    margin = float((record["d"][looks] - known["perturbation"][looks]).min())
    s, limit, c = record["s_norm"][promised], limit[promised], loop.certificate
    rest = np.sqrt(c.k_r_high / c.k_r_low) * max(-margin, 0.0) / c.lambda_min_K_s
    return Outside(scale, float((s / limit).max()), float((s / (limit + rest)).max()), margin, loop.stopped is not None)


def example() -> Example:
    """Example of a run that reaches its band."""
    loop = run(built(drawn("ur5", "hybrid", 0, 0)))
    return Example(*loop.recording.signals(("t", "s_norm", "s_bound", "s_band")).values())
