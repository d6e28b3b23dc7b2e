"""Runs of random arms: the promise for each, whether it is kept, and quantities that only the simulation knows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import msgspec
import numpy as np

from app.analysis.perturbation import PerturbationAnalysis
from app.evidence.plants import built, drawn, random_of, run, situation, with_arm_of, with_gains
from app.scenario.data import edited
from app.scenario.departures import Departure
from app.scenario.schema import Scenario, ScenarioError
from app.simulation.closed_loop import ClosedLoop

RIGID = "constrained"
PLANTS = 5  # in each situation
LOOKS = 12  # instants of each run before s is reached, and as many later, at which the true arm is examined
SCALES = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0)
CAUSES = ("inertia", "Coriolis", "gravity", "moving task", "disturbance", "ε")  # of the signal `needed`
PARTS = {"inertia": 0, "coriolis": 1, "gravity": 2, "disturbance": 4}  # of the perturbation, by their cause


@dataclass(frozen=True)
class Deadline:
    """A promised time and the measured one, both in s after the beginning; measured: infinite for never."""

    promised: float
    measured: float

    @property
    def ratio(self) -> float:
        """Ratio of the measured time to the promised one."""
        return self.measured / self.promised


@dataclass(frozen=True)
class Plant:
    """One of the plants, drawn inside the declared set.
    failed: title of the premise that failed first, "" for none.
    stopped: why the run ended early, "" where it did not.
    lagging: the multiplier is read one period late."""

    robot: str
    mode: str
    bounds: str
    lagging: bool
    verdict: str
    failed: str = ""
    stopped: str = ""


@dataclass(frozen=True)
class Refused(Plant):
    """A plant that does not start: its gain by (17) would feed itself."""


@dataclass(frozen=True)
class Reaching(Plant):
    """One run; all figures count only periods with a promise, and are nan where there are none.

    s_0: ||s|| at the start, m/s.
    share: of the periods.
    excess: of ||s|| beyond (20) and the band, m/s.
    early_excess: beyond (20) alone until the band is reached, nan where it began there.
    tightness: largest ||s|| over (20) with band; V_tightness: largest V over (24) meanwhile.
    layer, band: see `Deadline`, None where a premise failed before, or there was nothing to reach.
    known: promise for the band from the true V(0), and the least that d had to spare in place of epsilon.
    margin: least d - perturbation, N.
    used: largest perturbation over d - epsilon.
    shares: (6,), mean share of each cause in (17).
    used_parts: (4,), largest part of the perturbation over its bound.
    """

    s_0: float = np.nan
    share: float = 0.0
    excess: float = np.nan
    early_excess: float = np.nan
    tightness: float = np.nan
    V_tightness: float = np.nan
    layer: Deadline | None = None
    band: Deadline | None = None
    known: float = np.nan
    margin: float = np.nan
    used: float = np.nan
    shares: np.ndarray = field(default_factory=lambda: np.full(len(CAUSES), np.nan))
    used_parts: np.ndarray = field(default_factory=lambda: np.full(len(PARTS), np.nan))

    @property
    def band_ratio(self) -> float:
        """Ratio of the time to the band to the promised one."""
        return np.nan if self.band is None else self.band.ratio

    @property
    def known_ratio(self) -> float:
        """Ratio of the time to the band to the one that the true perturbation would promise."""
        return np.nan if self.band is None or not self.known > 0.0 else self.band.measured / self.known


@dataclass(frozen=True)
class Outside:
    """One run of an arm `scale` times as far away as declared, from s(0) = 0 on, judged as if it were inside.
    over_band, over_rest: largest ||s|| over its band, and over the rest of the promise by (23), among the periods in
    which all other premises hold, nan without any.
    margin: least d - perturbation there, N."""

    scale: float
    over_band: float
    over_rest: float
    margin: float
    stopped: bool


@dataclass(frozen=True)
class Example:
    """An example for a figure: ||s||, its bound (20) and the sampling band, (N,) m/s, over t (N,) s."""

    t: np.ndarray
    s: np.ndarray
    bound: np.ndarray
    band: np.ndarray


def reach(robot: str, mode: str, seed: int) -> list[Plant]:
    """Plants of one situation."""
    return _reached([drawn(robot, mode, seed, number) for number in range(PLANTS)], lagging=False)


def lag(robot: str) -> list[Plant]:
    """Plants of one situation on a rigid surface, where the multiplier is read one period late."""
    late = [edited(drawn(robot, RIGID, 0, number), "sensor.ideal", False) for number in range(PLANTS)]
    return _reached(late, lagging=True)


def _reached(scenarios: Sequence[Scenario], *, lagging: bool) -> list[Plant]:
    found: list[Plant] = []
    previous = None
    for scenario in scenarios:
        about = scenario.robot.name, scenario.mode, scenario.controller.bounds, lagging
        previous = built(scenario, previous)
        try:
            found.append(_reaching(run(previous), Plant(*about, "nothing promised")))
        except ScenarioError as error:
            if not str(error).startswith("controller.bounds"):
                raise
            found.append(Refused(*about, "nothing promised"))
    return found


def _reaching(loop: ClosedLoop, about: Plant) -> Reaching:
    record = loop.recording.signals(tuple(loop.recording.columns))
    s, limit = record["s_norm"], record["s_bound"] + record["s_band"]
    promised = np.isfinite(limit)
    standing = loop.standing
    first = min((f for f in standing.findings if f.failed is not None), key=lambda f: f.failed or 0.0, default=None)
    judged = replace(
        about, verdict=standing.run.verdict, failed=first.title if first else "", stopped=loop.stopped or ""
    )
    found = Reaching(**vars(judged), s_0=float(s[0]), share=float(promised.mean()))
    if not promised.any():
        return found
    early = _before_band(record, promised)
    until = np.inf if first is None or first.failed is None else first.failed
    epoch = loop.recording.epochs[0]
    found = replace(
        found,
        excess=float((s - limit)[promised].max()),
        early_excess=float((s - record["s_bound"])[early].max()) if early.any() else np.nan,
        tightness=float((s / limit)[promised].max()),
        layer=_deadline(epoch.reached_by, epoch.reached, until, loop.t),
        band=_deadline(epoch.banded_by, epoch.banded, until, loop.t),
    )
    return _with_true_perturbation(found, loop, record, promised, early)


def _before_band(record: Mapping[str, np.ndarray], promised: np.ndarray) -> np.ndarray:
    """Mask (N,) of the rows with a promise that come before ||s|| is first within the band since that promise began."""
    early, reached = promised.copy(), False
    for i in range(len(promised)):
        reached = promised[i] and (reached or record["s_norm"][i] <= record["s_band"][i])
        early[i] &= not reached
    return early


def _deadline(promised: float | None, measured: float | None, until: float, end: float) -> Deadline | None:
    """Deadline of a promised and a measured time; None for one that was not promised, was met from the beginning, or
    before which a premise failed (`until`, s), and for one that the run's end (s) left open."""
    if promised is None or measured == 0.0 or promised <= 0.0 or promised >= until:
        return None
    if measured is None and promised > end:
        return None
    return Deadline(promised, np.inf if measured is None else measured)


def _with_true_perturbation(
    found: Reaching, loop: ClosedLoop, record: Mapping[str, np.ndarray], promised: np.ndarray, early: np.ndarray
) -> Reaching:
    """The run with the quantities that only the simulation can know: V, and the perturbation that d outweighs."""
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
    parts = np.stack([known[name][looks] for name in PARTS])
    bounds = needed[:, list(PARTS.values())].T.copy()  # both are zero for Coriolis forces at rest
    bounds[0] += needed[:, CAUSES.index("moving task")]  # (7) has two bounds for the one term M q_eq_ddot
    return replace(
        found,
        V_tightness=float((V[reaching] / V_bound[reaching]).max(initial=0.0)) if reaching.any() else np.nan,
        known=time,
        margin=float((d - real).min()),
        used=float((real / (d - epsilon)).max()),
        shares=(needed / needed.sum(axis=1, keepdims=True)).mean(axis=0),
        used_parts=np.divide(parts, bounds, out=np.zeros_like(parts), where=bounds > 0.0).max(axis=1),
    )


def _some(rows: np.ndarray) -> np.ndarray:
    """At most `LOOKS` of the rows, first and last included."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, LOOKS).astype(int))] if len(rows) else rows


def outside(robot: str, mode: str, seed: int) -> list[Outside]:
    """Runs of one corner of the declared set, moved away from the nominal arm step by step."""
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
    """Figures of a loop that believes its arm to be inside, so that it goes on to judge the other premises and the
    band."""
    record = loop.recording.signals(tuple(loop.recording.columns))
    limit = record["s_bound"] + record["s_band"]
    promised = np.flatnonzero(np.isfinite(limit))
    if not len(promised):
        return Outside(scale, np.nan, np.nan, np.nan, loop.stopped is not None)
    looks = promised[np.unique(np.linspace(0, len(promised) - 1, 4 * LOOKS).astype(int))]
    epochs = [replace(epoch, scenario=scenario) for epoch in loop.recording.epochs]  # of the true arm
    known = PerturbationAnalysis(loop.system).recorded(record, epochs, looks)
    margin = float((record["d"][looks] - known["perturbation"][looks]).min())
    s, limit, c = record["s_norm"][promised], limit[promised], loop.certificate
    rest = np.sqrt(c.k_r_high / c.k_r_low) * max(-margin, 0.0) / c.lambda_min_K_s
    return Outside(scale, float((s / limit).max()), float((s / (limit + rest)).max()), margin, loop.stopped is not None)


def example() -> Example:
    """Example of one run."""
    loop = run(built(drawn("ur5", "hybrid", 0, 0)))
    return Example(*loop.recording.signals(("t", "s_norm", "s_bound", "s_band")).values())
