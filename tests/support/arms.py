"""Arms in task coordinates of every kind, with random states and random laws: what identities are checked on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import msgspec
import numpy as np

from app.evidence.twins import arm, random_spd
from app.scenario.data import edited
from app.simulation.assembly import assemble
from app.simulation.system import System
from controllers.bounds import Uncertainty
from controllers.compensator import Compensator
from controllers.control_law import Reference
from controllers.controller import Controller
from controllers.estimate_rates import Lipschitz
from controllers.laws.table import LAWS
from controllers.switching import SwitchingFunction
from controllers.target_model import TargetModel
from environments.acceleration import PlantState
from environments.catalogue import CATALOGUE
from environments.surfaces.corner import Corner
from environments.surfaces.form import SurfaceMotion
from environments.surfaces.table import Surface
from tests.support.surfaces import AT_REST, cylinder, formula, plane, sphere

ROBOTS = tuple(CATALOGUE)
CERTAIN = Uncertainty(*10 * (0.0,))
MOTION = SurfaceMotion(direction=(0.6, 0.0, 0.8), amplitude=0.03, frequency=1.7)
TOWARDS, RADIUS = np.array([0.28, 0.0, -0.96]), 0.4  # m
WAVE = "0.96*z - 0.28*x - 0.02*sin(7*(x + z) - 2*t) + 0.3*x^2"


class State(NamedTuple):
    """q (n,) rad, q_dot (n,) rad/s, t s."""

    q: np.ndarray
    q_dot: np.ndarray
    t: float


def lipschitz_of(system: System) -> Lipschitz:
    """Lipschitz constants over the system's Omega, which only estimates along the reference need."""
    found = assemble(edited(system.scenario, "controller.estimates", "along-reference")).constants.lipschitz
    assert found is not None
    return found


@cache
def charted(robot: str, chart: str) -> System:
    """The arm in one of CHARTS: surfaces are oblique, some centimetres off, and fit an arm in the x-z plane."""
    system = arm(robot)
    if chart == "cartesian":
        return system
    if chart == "joint":
        return replace(system, layout=system.layout._replace(joint=True))
    middle = system.nominal.evaluate(system.q_0, np.zeros(system.robot.n)).p + 0.03 * TOWARDS
    return replace(system, charted=CHARTED[chart](middle))


def _hollow(middle: np.ndarray) -> Surface:
    axis = np.array([0.0, 1.0, 0.0])
    return cylinder(middle - RADIUS * TOWARDS, axis, TOWARDS, RADIUS, "inside", MOTION)


def _corner(middle: np.ndarray) -> Corner:
    motion = SurfaceMotion(direction=(1.0, 0.0, 0.0), amplitude=0.02)
    return Corner((plane(middle, np.array([0.8, 0.0, -0.6]), motion), _hollow(middle)), middle)


# what is met at a place (3,) m, by chart; all surfaces move
CHARTED: dict[str, Callable[[np.ndarray], Surface | Corner]] = {
    "plane": lambda middle: plane(middle, TOWARDS, MOTION),
    "cylinder inside": _hollow,
    "sphere outside": lambda middle: sphere(middle + RADIUS * TOWARDS, -TOWARDS, RADIUS, "outside", MOTION),
    "typed wave": lambda middle: formula(WAVE, middle, TOWARDS, middle, MOTION),
    "corner": _corner,
}
CHARTS = ("joint", "cartesian", *CHARTED)


def at_rest(surface: Surface | Corner) -> tuple[Surface, ...]:
    """The surface, or those of a corner, without motion, a wave as it is at an instant."""
    if isinstance(surface, Corner):
        return tuple(still for each in surface.surfaces for still in at_rest(each))
    form = msgspec.structs.replace(surface.form, motion=AT_REST)
    if surface.changing:
        form = msgspec.structs.replace(form, text=WAVE.replace("2*t", "0.6"))
    return (Surface.of(form, surface.near),)


def random_state(system: System, random: np.random.Generator) -> State:
    """Every joint within 0.3 rad of the working posture."""
    n = system.robot.n
    return State(
        system.robot.posture + random.uniform(-0.3, 0.3, n), random.uniform(-1.0, 1.0, n), random.uniform(0.0, 2.0)
    )


def answered(system: System, state: PlantState, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Multipliers (3,) N of the contact and q_ddot (n,) rad/s^2 under the torque tau (n,) N m in a state at t = 0."""
    multipliers, after = system.plant.respond(state, tau, 0.0, 1e-3).multiplier, state.copy()
    system.plant.advance(after, tau, 0.0, 1e-3)
    return multipliers, after.views.q_ddot


def random_reference(r: np.ndarray, random: np.random.Generator) -> Reference:
    """A reference near r (n,), with a desired force."""
    away, r_d_dot, r_d_ddot, F_cd = random.standard_normal((4, len(r)))
    return Reference(r + 0.05 * away, r_d_dot, r_d_ddot, F_cd)


def random_law(
    random: np.random.Generator,
    n: int,
    switching: SwitchingFunction,
    controlled: np.ndarray,
    m: int = 0,
    kind: str = "vsmrc",
) -> Controller:
    """Of a law: full matrices wherever the paper allows them; d a constant."""
    M_m, B_m, K_m = (random_spd(random, n, 1.0, 30.0) for _ in range(3))
    model = TargetModel(M_m, B_m, K_m, random.standard_normal((n, n)))
    A, F_1, F_2 = -random.uniform(0.0, 5.0, n), random.uniform(-10.0, 10.0, n), random.uniform(0.5, 2.0, n)
    return Controller(
        law=LAWS[kind],
        model=model,
        compensator=Compensator.design(model, A, F_1, F_2),
        K_s=random_spd(random, n, 1.0, 50.0),
        d=random.uniform(1.0, 20.0),
        epsilon=1.0,
        bounds="tight",
        switching=switching,
        layer=random.uniform(0.01, 10.0),
        uncertainty=CERTAIN,
        controlled=controlled,
        surfaces=m,
    )


# eta(r, w) for r = ||s|| > 0 and a layer w, written without the product
ETA: dict[str, Callable[[float, float], float]] = {
    "discontinuous": lambda _r, _w: 1.0,
    "saturation": lambda r, w: min(1.0, r / w),
    "rational": lambda r, w: r / (r + w),
    "tanh": lambda r, w: float(np.tanh(r / w)),
}


def unit_vector(s: np.ndarray, function: SwitchingFunction, layer: float) -> np.ndarray:
    """sigma(s) (n,) = eta(||s||) s/||s||, zero at s = 0."""
    r = float(np.linalg.norm(s))
    return s * ETA[function.kind](r, layer) / r if r > 0.0 else np.zeros_like(s)
