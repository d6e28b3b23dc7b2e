"""Plants drawn from a declared set, and states of an arm, for tests of bounds."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from app.scenario.data import edited
from app.scenario.declared_bounds import symmetric
from app.scenario.departures import Departure
from app.simulation.system import System
from controllers.bounds import Uncertainty
from controllers.task_space import TaskSpace
from environments.truth import Truth
from tests.support.arms import State, charted

CHART = "sphere outside"  # moves, and is curved
DECLARED = Uncertainty(0.25, 0.3, 1.5, 0.08, 0.6, 0.4, 3.0, 2.0, 0.4, k_C=np.nan, rho_centre=0.01, rho_shape=0.2)


class Plant(NamedTuple):
    """A true arm, and the error (6,) of its sensor of force and moment."""

    truth: Truth
    wrench_error: np.ndarray


def direction(random: np.random.Generator, n: int) -> np.ndarray:
    v = random.standard_normal(n)
    return v / np.linalg.norm(v)


def draw(u: Uncertainty, random: np.random.Generator, n: int) -> Plant:
    """Anywhere in the declared set, in half the draws of each quantity at its edge."""

    def fraction() -> float:
        return min(1.0, random.uniform(0.0, 2.0))

    scaling, rotors = (1.0 + rho * np.clip(random.uniform(-2.0, 2.0, n), -1.0, 1.0) for rho in (u.rho, u.rho_rotor))
    offset = u.payload_offset * fraction() * direction(random, 3)
    numbers = (u.payload_mass * fraction(), offset, *(x * fraction() for x in (u.coulomb, u.viscous, u.disturbance)))
    departure = Departure.inside(random, n)
    truth = Truth(
        scaling, *numbers, disturbance_frequency=0.7, rotor_scaling=rotors,
        link_centre=u.rho_centre * departure.centres, link_shape=u.rho_shape * symmetric(departure.shapes),
    )  # fmt: skip
    errors = (u.force_error * fraction() * direction(random, 3), u.moment_error * fraction() * direction(random, 3))
    return Plant(truth, np.concatenate(errors))


def doubted(robot: str, **declared: float | str) -> System:
    """The arm before the moving surface, whose links' centres and shapes are in doubt, or with other declarations."""
    system = charted(robot, CHART)
    scenario = system.scenario
    for name, value in (declared or {"link_centre": 0.01, "link_shape": 0.2}).items():
        scenario = edited(scenario, f"declared.{name}", value)
    return replace(system, scenario=scenario)


def draw_state(system: System, random: np.random.Generator) -> State:
    """A posture in Omega; slow and fast."""
    n, radius = system.robot.n, system.constants.radius
    q = system.q_0 + radius * random.uniform() ** (1 / n) * direction(random, n)
    return State(q, 10 ** random.uniform(-2.0, 0.5) * direction(random, n), random.uniform(0.0, 2.0))


def in_task_space(task: TaskSpace, M: np.ndarray) -> np.ndarray:
    """A matrix (n, n) of the joints in task coordinates."""
    return task.J_q_inv.T @ M @ task.J_q_inv
