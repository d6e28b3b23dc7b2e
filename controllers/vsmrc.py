"""The control law of Theorem 1 as a sum of named torque terms: (9), (10), (15)-(17), (25)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numba import njit

from controllers.bounds import RequiredGain, Uncertainty, paper_bound, tight_bound
from controllers.compensator import Compensator
from controllers.nominal_model import Deviation, Estimate
from controllers.switching import Switching, unit_vector
from controllers.target_model import InvalidGain, TargetModel, as_matrix, require_spd
from controllers.task_space import TaskSpace


class Reference(NamedTuple):
    """r_d m, r_d_dot m/s, r_d_ddot m/s^2, F_cd N: each (n,)."""

    r_d: np.ndarray
    r_d_dot: np.ndarray
    r_d_ddot: np.ndarray
    F_cd: np.ndarray


class LawState(NamedTuple):
    """The memory of the law: the compensator's state z (n,)."""

    z: np.ndarray


class TorqueTerms(NamedTuple):
    """The terms of (25), each (n,) N m; tau is their sum."""

    inertia: np.ndarray  # M_hat q_eq_ddot
    coriolis: np.ndarray  # C_hat q_eq_dot
    gravity: np.ndarray  # G_hat
    force: np.ndarray  # J^T F
    linear: np.ndarray  # -J_q^T K_s s
    switching: np.ndarray  # -J_q^T d sigma(s)


class ControlOutput(NamedTuple):
    """tau (n,) N m and its terms; errors e_r m, e_r_dot m/s, e_Fc N; F_c N; z, z_dot; s m/s; d N; needed: (17)."""

    tau: np.ndarray
    terms: TorqueTerms
    e_r: np.ndarray
    e_r_dot: np.ndarray
    F_c: np.ndarray
    e_Fc: np.ndarray
    z: np.ndarray
    z_dot: np.ndarray
    s: np.ndarray
    d: float
    needed: RequiredGain


class ModelMatrices(NamedTuple):
    """M_m, B_m, K_m, K_f of (8), each (n, n)."""

    M_m: np.ndarray
    B_m: np.ndarray
    K_m: np.ndarray
    K_f: np.ndarray


class Gains(NamedTuple):
    """What the kernel needs of the law's parameters: see `Compensator` and `Vsmrc`. robust: False for the baseline."""

    robust: bool
    model: ModelMatrices
    A: np.ndarray
    F_1: np.ndarray
    F_2: np.ndarray
    K_pz: np.ndarray
    K_vz: np.ndarray
    K_fz: np.ndarray
    K_s: np.ndarray
    controlled: np.ndarray
    K_s_largest: float
    m: int
    by_theorem: bool
    d: float
    epsilon: float
    tight: bool
    switching: int
    phi: float
    uncertainty: Uncertainty


@njit(cache=True, error_model="numpy")
def controlled_force(task, tau_F, F, controlled, m):
    """F_c (n,): the entries of F_r = J_q^-T J^T F in `controlled`; the first m are the multiplier, (39), (40)."""
    F_r = task.J_q_inv.T @ tau_F
    if m > 0:
        F_r[0] = (task.normal @ F) / (task.normal @ task.normal)
    return controlled * F_r


@njit(cache=True, error_model="numpy")
def vsmrc_law(gains, z, reference, task, estimate, deviation, q_dot, F):
    """One evaluation of (25) for the compensator state z (n,) and measured force F (3,) N."""
    e_r = task.r - reference.r_d
    e_r_dot = task.r_dot - reference.r_d_dot
    tau_F = estimate.J_v.T @ F
    F_c = controlled_force(task, tau_F, F, gains.controlled, gains.m)
    e_Fc = gains.controlled * (F_c - reference.F_cd)

    z_dot = gains.A @ z + gains.K_pz @ e_r + gains.K_vz @ e_r_dot + gains.K_fz @ e_Fc  # (9)
    s = e_r_dot + gains.F_1 @ e_r + gains.F_2 @ z  # (10)
    r_eq_dot = reference.r_d_dot - gains.F_1 @ e_r - gains.F_2 @ z  # (16)
    r_eq_ddot = reference.r_d_ddot - gains.F_1 @ e_r_dot - gains.F_2 @ z_dot
    q_eq_dot = task.J_q_inv @ (r_eq_dot - task.v_t)  # (25)
    q_eq_ddot = task.J_q_inv @ (r_eq_ddot - task.J_q_dot @ q_eq_dot - task.v_t_dot)

    u = gains.uncertainty
    if gains.tight:
        inertia, coriolis, gravity, motion, disturbance = tight_bound(
            u, deviation, estimate, task, q_dot, q_eq_dot, q_eq_ddot
        )
    else:
        inertia, coriolis, gravity, motion, disturbance = paper_bound(
            u, deviation, estimate, task, q_dot, r_eq_dot, r_eq_ddot
        )
    needed = RequiredGain(inertia, coriolis, gravity, motion, disturbance, gains.epsilon)
    d = gains.d
    if gains.by_theorem:
        d = inertia + coriolis + gravity + motion + disturbance + gains.epsilon  # (17)

    J_q_T = task.J_q.T
    terms = TorqueTerms(
        estimate.M_hat @ q_eq_ddot,
        estimate.C_hat @ q_eq_dot,
        estimate.G_hat.copy(),
        tau_F,
        -(J_q_T @ (gains.K_s @ s)),
        -(J_q_T @ (d * unit_vector(s, gains.switching, gains.phi))),
    )
    tau = terms.inertia + terms.coriolis + terms.gravity + terms.force + terms.linear + terms.switching  # (25)
    return ControlOutput(tau, terms, e_r, e_r_dot, F_c, e_Fc, z, z_dot, s, d, needed)


@njit(cache=True, error_model="numpy")
def computed_torque(unified, model, reference, task, estimate, q_dot):
    """The baseline: the r_ddot that (8) asks for, by M_hat, C_hat, G_hat alone; z and s are carried along."""
    wanted = -(model.B_m @ unified.e_r_dot + model.K_m @ unified.e_r + model.K_f @ unified.e_Fc)
    r_ddot = reference.r_d_ddot + np.linalg.solve(model.M_m, wanted)
    q_ddot = task.J_q_inv @ (r_ddot - task.J_q_dot @ q_dot - task.v_t_dot)
    zero = np.zeros_like(q_dot)
    terms = TorqueTerms(
        estimate.M_hat @ q_ddot, estimate.C_hat @ q_dot, unified.terms.gravity, unified.terms.force, zero, zero.copy()
    )
    tau = terms.inertia + terms.coriolis + terms.gravity + terms.force
    u = unified
    return ControlOutput(tau, terms, u.e_r, u.e_r_dot, u.F_c, u.e_Fc, u.z, u.z_dot, u.s, 0.0, u.needed)


@njit(cache=True, error_model="numpy")
def control_law(gains, z, reference, task, estimate, deviation, q_dot, F):
    """(25), or the baseline where `gains.robust` is False."""
    output = vsmrc_law(gains, z, reference, task, estimate, deviation, q_dot, F)
    if gains.robust:
        return output
    return computed_torque(output, gains.model, reference, task, estimate, q_dot)


@dataclass(frozen=True)
class Vsmrc:
    """The sliding-mode law for one target model.

    K_s (n, n) s.p.d., N s/m; d N: a constant, or None for the theorem's (17); epsilon N > 0; switching with boundary
    layer phi m/s; bounds: see `controllers.bounds`; controlled (n,) and m: see `controllers.modes`.
    Raises InvalidGain.
    """

    model: TargetModel
    compensator: Compensator
    K_s: np.ndarray
    d: float | None
    epsilon: float
    bounds: Literal["tight", "paper"]
    switching: Switching
    phi: float
    uncertainty: Uncertainty
    controlled: np.ndarray
    m: int
    robust: ClassVar[bool] = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "K_s", as_matrix("controller.K_s", self.K_s, self.model.n))
        require_spd("controller.K_s", self.K_s)
        for name, value, least in (("epsilon", self.epsilon, 0.0), ("d", self.d, 0.0)):
            if value is not None and not (np.isfinite(value) and value > least):
                raise InvalidGain(f"controller.{name}: {value}; allowed: a number > {least}")
        if self.switching is not Switching.DISCONTINUOUS and not (np.isfinite(self.phi) and self.phi > 0.0):
            raise InvalidGain(f"controller.layer: {self.phi}; allowed: a number > 0, or switching = 'discontinuous'")

    @cached_property
    def gains(self) -> Gains:
        """The parameters in the kernel's form."""
        c, model = self.compensator, self.model
        arrays = (c.A, c.F_1, c.F_2, c.K_pz, c.K_vz, c.K_fz, self.K_s, self.controlled)
        return Gains(
            self.robust,
            ModelMatrices(*(np.array(a) for a in (model.M_m, model.B_m, model.K_m, model.K_f))),
            *(np.array(a, dtype=float, order="C") for a in arrays),
            K_s_largest=float(np.linalg.eigvalsh(self.K_s)[-1]),
            m=self.m,
            by_theorem=self.d is None,
            d=float(self.d or 0.0),
            epsilon=float(self.epsilon),
            tight=self.bounds == "tight",
            switching=int(self.switching),
            phi=float(self.phi),
            uncertainty=self.uncertainty,
        )

    def init(self, e_r: np.ndarray, e_r_dot: np.ndarray, *, remove_reaching: bool) -> LawState:
        """z(0): Remark 2's, for which s(0) = 0, or zero, to watch s being reached."""
        return LawState(self.compensator.without_reaching(e_r, e_r_dot) if remove_reaching else np.zeros(self.model.n))

    def evaluate(
        self,
        state: LawState,
        reference: Reference,
        task: TaskSpace,
        estimate: Estimate,
        deviation: Deviation,
        q_dot: np.ndarray,
        F: np.ndarray,
    ) -> ControlOutput:
        """(25) at one instant; q_dot (n,) rad/s, F (3,) N measured force of the tool on the environment.

        deviation: how far the estimates may be from those at q, zero when they are taken on-line (Remark 3).
        """
        return control_law(self.gains, state.z, reference, task, estimate, deviation, q_dot, F)

    def next(self, output: ControlOutput, period: float) -> LawState:
        """z one control period (s) later."""
        return LawState(output.z + period * output.z_dot)
