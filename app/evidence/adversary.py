"""Adversary: an optimiser that searches for an arm, a start and gains with which ||s|| breaks its promised bound."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np
from scipy.optimize import differential_evolution

from app.evidence.plants import BOUNDS, LAYERS, built, largest_ratio, random_of, run, situation
from app.scenario.data import edited, to_toml
from app.scenario.departures import Departure
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.simulation.closed_loop import ClosedLoop
from controllers.switching import SWITCHING

SEED = 1000  # of the situations, other ones than those of the random arms
POPULATION, GENERATIONS = 25, 11  # of each hunt: 275 tries, or 50 where all are refused
DURATION = 0.15  # s
START = 0.03  # rad, largest displacement of each joint from the start of the path; 0 on a rigid surface
SHARED = 18  # numbers of a try besides nine for each joint
PAPER_FROM = 0.5  # on [-1, 1]: a quarter of the first tries have the bounds of (7)
KINDS = tuple(SWITCHING)


@dataclass(frozen=True)
class Hunt:
    """Hunt: all tries in one situation.
    reaching: whether s(0) is not zero.
    refused: number of tries that do not start, since the feedback of their gain (17) to itself is too large.
    promised: number of tries with a promise.
    broken: number of tries whose promise was not kept.
    ratio: largest ||s|| over (20) with its band, in periods with a promise; 0 without any promise.
    worst: scenario of the try with this ratio, as TOML.
    off: displacement (n,) rad of the start of its arm from the scenario's posture."""

    robot: str
    mode: str
    reaching: bool
    tries: int
    refused: int
    promised: int
    broken: int
    ratio: float
    worst: str
    off: tuple[float, ...]


class HuntingGround:
    """Ground of a hunt: the system of a situation, built once, since a try changes neither Omega nor its constants."""

    def __init__(self, robot: str, mode: str, *, reaching: bool) -> None:
        here = edited(situation(robot, mode, SEED), "simulation.duration", DURATION)
        self.scenario = edited(here, "controller.on_change", "watch" if reaching else "remove")
        self.system = built(self.scenario)
        self.posture, self.n = self.system.robot.posture, self.system.robot.n
        self.size = 9 * self.n + SHARED

    def scenario_of(self, x: np.ndarray) -> Scenario:
        """Scenario of a try, without its displacement of the start. x: numbers (size,) within [-1, 1]."""
        n, here = self.n, self.scenario
        links, shared, rotors = _edged(x[:n]), x[n : n + SHARED], _edged(x[2 * n + SHARED : 3 * n + SHARED])
        shifts, moments = np.split(_edged(x[3 * n + SHARED :]).reshape(2 * n, 3), 2)
        centres = shifts / np.maximum(np.linalg.norm(shifts, axis=1, keepdims=True), 1.0)
        shapes = np.hstack([moments, np.zeros((n, 3))])
        payload, offset, coulomb, viscous, disturbance = _fraction(_edged(shared[:5])).tolist()
        frequency, towards = _between(shared[5], 0.2, 20.0), shared[6:9] / max(float(np.linalg.norm(shared[6:9])), 1e-9)
        K_s, epsilon, F_1, layer, kind, bounds, K_e, force, friction = shared[9:]
        departure = Departure(
            links, rotors, centres, shapes, payload, offset, towards, coulomb, viscous, disturbance, frequency
        )
        controller = msgspec.structs.replace(
            here.controller,
            K_s=10 ** _between(K_s, 1.3, 2.5),
            epsilon=10 ** _between(epsilon, 0.0, 1.3),
            F_1=_between(F_1, 8.0, 20.0),
            layer=float(np.exp(_between(layer, *np.log(LAYERS)))),
            switching=KINDS[min(int(_fraction(kind) * len(KINDS)), len(KINDS) - 1)],
            bounds=BOUNDS[int(bounds > PAPER_FROM)],
        )
        contact = msgspec.structs.replace(here.contact, K_e=10 ** _between(K_e, 3.0, 4.0))
        if contact.kind == "elastic":
            contact = msgspec.structs.replace(contact, friction_viscous=_between(friction, 0.0, 30.0))
        return msgspec.structs.replace(
            here,
            truth=departure.truth(here.declared),
            controller=controller,
            contact=contact,
            force=msgspec.structs.replace(here.force, value=_between(force, 5.0, 30.0)),
        )

    def off(self, x: np.ndarray) -> np.ndarray:
        """Displacement (n,) rad of the arm's start from its posture, in a try. x: see `scenario_of`."""
        return START * x[self.n + SHARED : 2 * self.n + SHARED] * (not self.system.plant.nature.rigid)

    def attempt(self, x: np.ndarray) -> ClosedLoop:
        """Run of a try. x: see `scenario_of`. Raises ScenarioError for a refused try."""
        system = built(self.scenario_of(x), self.system)
        started = replace(system.robot, posture=self.posture + self.off(x))
        return run(replace(system, robot=started))


def hunt(robot: str, mode: str, reaching: bool, generations: int = GENERATIONS) -> Hunt:
    """Hunt by differential evolution, which begins with corners of the declared set and draws from inside, half of
    each."""
    ground, random = HuntingGround(robot, mode, reaching=reaching), random_of(robot, mode, SEED, int(reaching))
    ratios: list[float | None] = []
    broken = 0

    def away(x: np.ndarray) -> float:
        nonlocal broken
        try:
            loop = ground.attempt(x)
        except ScenarioError:
            ratios.append(None)
            return 1.0
        ratio = largest_ratio(loop.recording.stretch())
        ratios.append(ratio)
        broken += loop.standing.run.verdict == "broken"
        return -ratio

    first = random.uniform(-1.0, 1.0, (POPULATION, ground.size))
    corner = [*range(ground.n + 5), *range(2 * ground.n + SHARED, ground.size)]
    first[::2, corner] = np.sign(first[::2, corner])
    rules: dict[str, Any] = {"init": first, "maxiter": generations - 1, "tol": 0.0, "polish": False, "rng": random}
    found = differential_evolution(away, [(-1.0, 1.0)] * ground.size, **rules)
    known = [ratio for ratio in ratios if ratio is not None]
    return Hunt(
        robot=robot,
        mode=mode,
        reaching=reaching,
        tries=len(ratios),
        refused=len(ratios) - len(known),
        promised=sum(ratio > 0.0 for ratio in known),
        broken=broken,
        ratio=max(known, default=0.0),
        worst=to_toml(ground.scenario_of(found.x)),
        off=tuple(ground.off(found.x).tolist()),
    )


def _edged(x: np.ndarray) -> np.ndarray:
    """Numbers of [-1, 1], with those of its outer halves moved to the ends."""
    return np.clip(2.0 * x, -1.0, 1.0)


def _fraction(x: Any) -> Any:
    """Position of x in [-1, 1] as a share, 0 to 1."""
    return 0.5 * (x + 1.0)


def _between(x: float, low: float, high: float) -> float:
    return float(low + _fraction(x) * (high - low))
