"""True errors of the controller's model at each state, against the bounds of (7) that a scenario states itself: only
the simulation knows the true arm, and checks in each control period whether it is inside the declared set."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.scenario.schema import STATED_IN, Declared
from app.scenario.units import Units
from controllers.nominal_model import Estimate, LinkConstants, NominalModel, StatedErrorBounds, estimates
from environments.plant import Plant
from environments.robots import Robot
from environments.truth import Resistance, resistance_torque
from kernels import allocating, inline
from kernels.algebra import norm
from kernels.rigid_body import Chain, Motion, estimated_terms, forward_kinematics, jacobian_rate, link_inertias

ROUNDING = 1e-9


class TrueErrors(NamedTuple):
    """Errors at one state: ||Delta M|| kg m^2, ||Delta C|| kg m^2/s, ||Delta G|| N m, ||f|| N m, NaN where no bound is
    stated; share: the largest c with M >= c M_hat, NaN unless delta_M is stated."""

    M: float
    C: float
    G: float
    f: float
    share: float


UNKNOWN = TrueErrors(*5 * (np.nan,))


class TrueArm(NamedTuple):
    """Data of the true arm for the check of its errors against the stated bounds.
    checked: whether any bound is stated; where none is, nothing else is read.
    outsiders: number of the inequalities between truth and declaration that are violated whatever the state.
    links, chain, resistance: of the true arm; motion, estimate: memory for its terms."""

    checked: bool
    outsiders: float
    least_inertia: float
    links: LinkConstants
    chain: Chain
    resistance: Resistance
    motion: Motion
    estimate: Estimate

    @classmethod
    def of(cls, declared: Declared, plant: Plant, robot: Robot, outsiders: int) -> TrueArm:
        """True arm of a plant. outsiders: number of the inequalities that it violates whatever the state."""
        links = LinkConstants.of(plant.model, robot.tool_joint, robot.tool_placement)
        return cls(
            checked=True,
            outsiders=float(outsiders),
            least_inertia=declared.least_inertia,
            links=links,
            chain=plant.chain,
            resistance=plant.truth.resistance,
            motion=Motion.zeros(robot.n),
            estimate=Estimate.zeros(robot.n),
        )

    @classmethod
    def unchecked(cls, believed: NominalModel, n: int) -> TrueArm:
        """True arm of n joints of which nothing is checked; the believed one stands in its place."""
        return cls(
            checked=False,
            outsiders=0.0,
            least_inertia=0.0,
            links=believed.constants,
            chain=believed.chain,
            resistance=Resistance(0.0, 0.0, 0.0, 0.0),
            motion=Motion.zeros(n),
            estimate=Estimate.zeros(n),
        )


def stated_in(declared: Declared) -> bool:
    """Whether any bound of (7) is stated itself."""
    return any(getattr(declared, name) is not None for name in STATED_IN)


@allocating
def check_errors(true, estimate, q, q_dot, t, found):
    """Compute the errors of `estimate` for the true arm; returns how many stated bounds are violated."""
    chain, motion, real, stated = true.chain, true.motion, true.estimate, estimate.stated
    forward_kinematics(chain, q, motion)
    jacobian_rate(q_dot, motion)
    link_inertias(chain, motion)
    estimated_terms(chain, motion)
    terms = (motion.momenta.T, motion.C.T, motion.J.T, motion.J_dot.T, motion.placements.T)
    estimates(true.links, *terms, q_dot, real)
    violated = 0
    if not np.isnan(stated.delta_M):
        found.M = np.linalg.norm(real.M_hat - estimate.M_hat, 2)
        half = np.linalg.inv(np.linalg.cholesky(estimate.M_hat))
        found.share = np.linalg.eigvalsh(half @ real.M_hat @ half.T)[0]
        violated += _over(found.M, stated.delta_M) + _over(true.least_inertia, found.share)
    if not np.isnan(stated.delta_C):
        found.C = np.linalg.norm(real.C_hat - estimate.C_hat, 2)
        violated += _over(found.C, stated.delta_C)
    if not np.isnan(stated.delta_G):
        found.G = norm(real.G_hat - estimate.G_hat)
        violated += _over(found.G, stated.delta_G)
    if not np.isnan(stated.delta_f):
        resistance_torque(true.resistance, q_dot, t, real.G_hat)
        found.f = norm(real.G_hat)
        violated += _over(found.f, stated.delta_f)
    return violated


@inline
def _over(value, most):
    return 0 if value <= most * (1.0 + ROUNDING) + ROUNDING else 1


def beyond(found: TrueErrors, stated: StatedErrorBounds, least_inertia: float, units: Units) -> tuple[str, ...]:
    """Violated inequalities at one state, each with both numbers."""
    shares = np.nan if np.isnan(stated.delta_M) else least_inertia
    compared = (
        ("‖ΔM‖", found.M, ">", stated.delta_M, "kg·m²", found.M, stated.delta_M),
        ("largest share c with M ≥ c M̂", found.share, "<", shares, "", shares, found.share),
        ("‖ΔC‖", found.C, ">", stated.delta_C, "kg·m²/s", found.C, stated.delta_C),
        ("‖ΔG‖", found.G, ">", stated.delta_G, "N·m", found.G, stated.delta_G),
        ("‖f̃‖", found.f, ">", stated.delta_f, "N·m", found.f, stated.delta_f),
    )
    return tuple(
        f"{what} = {units.with_unit(value, unit)} {sign} declared {units.with_unit(limit, unit)}"
        for what, value, sign, limit, unit, smaller, larger in compared
        if smaller > larger * (1.0 + ROUNDING) + ROUNDING
    )
