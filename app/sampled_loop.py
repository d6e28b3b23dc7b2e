"""What sampling makes of the loop through the contact, and whether that is to be warned of.

Against a rigid or heavy surface that is `controllers.force_loop`'s factor. Against an elastic one it is what one
control period makes of a small deviation from rest: the law acts on samples, so over a period its torque is constant
while the surface's force changes. Theorem 1 knows nothing of that; against a stiff surface the loop can swing up though
(8) is stable and the plant well resolved. So (9), (10), (15), (16) with the plant's own integrator and the force sensor
are applied once to each unit deviation, which makes the matrix of the linearised loop. It contracts where its spectral
radius is below 1.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from app.assembly import System
from controllers.bounds import Equivalent, required_gain
from controllers.force_loop import force_loop_factor
from controllers.nominal_model import ON_LINE, Estimate
from controllers.switching import Switching
from controllers.task_space import TaskSpace
from controllers.vsmrc import Law
from environments.stiffness import ROUNDING, STEPS

LONGEST_LINE = 100  # periods of delay, beyond which the matrix becomes too large to be judged in passing


def sampled_loop_warning(system: System, q: np.ndarray, t: float) -> str | None:
    """One sentence where the loop through the contact diverges at the posture q (n,) rad, with what helps."""
    factor = sampled_force_loop_factor(system, *system.observe(q, np.zeros_like(q), t), t)
    if abs(factor) >= 1.0:
        return (
            f"the sampled force loop diverges: its factor is {factor:.3g}, allowed: between -1 and 1; "
            "raise M_m along the normal, or set sensor.ideal"
        )
    growth = contact_loop_radius(system, q, t)
    if growth > 1.0 + ROUNDING:
        return (
            f"the sampled loop swings up on this surface: a deviation grows {growth:.4g} times each control period, "
            "allowed: below 1; lower contact.K_e, controller.period or sensor.delay, or widen controller.layer"
        )
    return None


def sampled_force_loop_factor(system: System, estimate: Estimate, task: TaskSpace, t: float) -> float:
    """See `controllers.force_loop`; nan where no force is fed back through a loop that sampling closes."""
    scenario, law = system.scenario, system.law
    if not system.plant.heavy or scenario.sensor.ideal or law.law is Law.PD_GRAVITY:
        return math.nan
    H_hat = task.J_q_inv.T @ estimate.M_hat @ task.J_q_inv
    M_e = math.inf if scenario.contact.kind == "rigid" else scenario.contact.M_e
    normal = _across(system, estimate, task, t)
    return force_loop_factor(H_hat, H_hat, law.model, normal, law.controlled * normal, M_e)


def _across(system: System, estimate: Estimate, task: TaskSpace, t: float) -> np.ndarray:
    """F_r per unit of lambda, (n,)."""
    return task.J_q_inv.T @ (estimate.J_v.T @ system.surface.chart(estimate.p, t).G[0])


def contact_loop_radius(system: System, q: np.ndarray, t: float) -> float:
    """Growth of a deviation per control period with the tool on the surface at the posture q (n,) rad, 1.

    nan where nothing is to be judged: no elastic surface, the discontinuous law (which chatters in any case), a
    sensor with a very long delay.
    """
    scenario, law, sensor, n = system.scenario, system.law, system.sensor, system.layout.n
    late = round(sensor.delay / sensor.period)
    if scenario.contact.kind != "elastic" or law.switching is Switching.DISCONTINUOUS or late > LONGEST_LINE:
        return np.nan
    still = np.zeros(n)
    estimate, task = system.observe(q, still, t)
    J_inv, c = task.J_q_inv, law.compensator
    H_hat = J_inv.T @ estimate.M_hat @ J_inv
    H_inv = np.linalg.inv(J_inv.T @ pin.crba(system.plant.model, system.plant.model.createData(), q) @ J_inv)
    across = _across(system, estimate, task, t)
    contact, simulation, period = scenario.contact, scenario.simulation, scenario.controller.period
    q_eq_dot = -J_inv @ task.v_t  # (16) and (25) where all errors and all rates of the reference are zero
    q_eq_ddot = -J_inv @ (task.J_q_dot @ q_eq_dot + task.v_t_dot)
    at_rest = Equivalent(still, still, q_eq_dot, q_eq_ddot)
    needed = required_gain(law.bounds, law.uncertainty, ON_LINE, estimate, task, still, at_rest)
    d = sum(needed) + law.epsilon if law.d is None else law.d
    robust = law.K_s + d / law.phi * np.eye(n)
    passed = 1.0 if sensor.cutoff == 0.0 else 1.0 - np.exp(-2 * np.pi * sensor.cutoff * period)

    def push(x: np.ndarray, v: np.ndarray) -> float:
        return float(across @ (contact.K_e * x + contact.B_e * v))

    def after_a_period(state: np.ndarray) -> np.ndarray:
        x, v, z = state[: 3 * n].reshape(3, n)
        line = state[3 * n :]  # readings, the newest one first
        line = np.concatenate([[line[0] + passed * (push(x, v) - line[0])], line])
        F_r = across * line[late]
        F_c = law.controlled * F_r
        z_dot = c.A @ z + c.K_pz @ x + c.K_vz @ v + c.K_fz @ F_c
        if law.law is Law.VSMRC:
            s = v + c.F_1 @ x + c.F_2 @ z
            T_r = H_hat @ (-c.F_1 @ v - c.F_2 @ z_dot) + F_r - robust @ s
        else:
            restoring = law.model.B_m @ v + law.model.K_m @ x
            if law.law is Law.PD_GRAVITY:
                T_r = -restoring
            else:
                T_r = F_r - H_hat @ np.linalg.solve(law.model.M_m, restoring + law.model.K_f @ F_c)
            z_dot = -z / period  # takes no part
        for _ in range(simulation.substeps):
            x, v = STEPS[simulation.integrator](
                lambda x, v: H_inv @ (T_r - across * push(x, v)), x, v, period / simulation.substeps
            )
        return np.concatenate([x, v, z + period * z_dot, line[:-1]])

    matrix = np.stack([after_a_period(unit) for unit in np.eye(3 * n + max(late, 1))], axis=1)
    return float(np.abs(np.linalg.eigvals(matrix)).max())
