"""The control law of Theorem 1 as a sum of named torque terms: (9), (10), (15)-(17), (25); and the baselines."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from controllers.bounds import Equivalent, RequiredGain, Uncertainty, paper_bound, sum_of, tight_bound
from controllers.compensator import Compensator
from controllers.nominal_model import Estimate
from controllers.reference_estimates import FeedforwardModel
from controllers.switching import Switching, unit_factor
from controllers.target_model import InvalidGain, TargetModel, as_matrix, require_spd
from controllers.task_space import Scratch, TaskSpace
from kernels import kernel, part
from kernels.algebra import copy, dot, norm, row_times, times, transposed_times
from kernels.records import Record


class Law(IntEnum):
    """What the torque is made of: (25), or one of the baselines that know no robust term."""

    VSMRC = 0
    COMPUTED_TORQUE = 1
    PD_GRAVITY = 2


COMPUTED_TORQUE, PD_GRAVITY = int(Law.COMPUTED_TORQUE), int(Law.PD_GRAVITY)


class Reference(NamedTuple):
    """r_d m, r_d_dot m/s, r_d_ddot m/s^2, F_cd N: each (n,)."""

    r_d: np.ndarray
    r_d_dot: np.ndarray
    r_d_ddot: np.ndarray
    F_cd: np.ndarray

    @classmethod
    def zeros(cls, n: int) -> Reference:
        """Of n coordinates."""
        return cls(*4 * (np.zeros(n),))


class TorqueTerms(NamedTuple):
    """The terms of (25), each (n,) N m; tau is their sum."""

    inertia: np.ndarray  # M_hat q_eq_ddot
    coriolis: np.ndarray  # C_hat q_eq_dot
    gravity: np.ndarray  # G_hat
    force: np.ndarray  # J^T F
    linear: np.ndarray  # -J_q^T K_s s
    switching: np.ndarray  # -J_q^T d sigma(s)


class ControlOutput(NamedTuple):
    """tau (n,) N m and its terms; errors e_r m, e_r_dot m/s, e_Fc N; F_c N; z_dot m/s^2; s m/s and its norm; d N;
    needed: (17); equivalent: the motion that the terms prescribe."""

    tau: np.ndarray
    terms: TorqueTerms
    e_r: np.ndarray
    e_r_dot: np.ndarray
    F_c: np.ndarray
    e_Fc: np.ndarray
    z_dot: np.ndarray
    s: np.ndarray
    s_norm: float
    d: float
    needed: RequiredGain
    equivalent: Equivalent

    @classmethod
    def zeros(cls, n: int) -> ControlOutput:
        """Of n coordinates."""
        v = np.zeros(n)
        terms = TorqueTerms(*6 * (v,))
        return cls(v, terms, v, v, v, v, v, v, 0.0, 0.0, RequiredGain.zeros(), Equivalent.zeros(n))


class ModelMatrices(NamedTuple):
    """M_m, its inverse, B_m, K_m, K_f of (8), each (n, n)."""

    M_m: np.ndarray
    M_m_inv: np.ndarray
    B_m: np.ndarray
    K_m: np.ndarray
    K_f: np.ndarray


class Gains(NamedTuple):
    """What the kernel needs of the law's parameters: see `Compensator` and `Vsmrc`; of the diagonal A, F_1, F_2 the
    diagonals (n,). law: a `Law`; damping_rate: ||M_m^-1 B_m + A|| (1/s), by which r_eq_ddot feeds e_r_dot back."""

    law: int
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
    K_s_smallest: float
    damping_rate: float
    m: int
    by_theorem: bool
    d: float
    epsilon: float
    tight: bool
    switching: int
    phi: float
    uncertainty: Uncertainty


@part
def controlled_force(gains, task, tau_F, F, F_c):
    """F_c (n,): the entries of F_r = J_q^-T J^T F in `controlled`; the first m are the multiplier, (39), (40)."""
    transposed_times(task.J_q_inv, tau_F, F_c)
    if gains.m > 0:
        F_c[0] = dot(task.normal, F) / dot(task.normal, task.normal)
    for i in range(F_c.shape[0]):
        F_c[i] *= gains.controlled[i]


@part
def errors(gains, reference, task, estimate, F, out):
    """e_r, e_r_dot and e_Fc, with J^T F and F_c on the way."""
    transposed_times(estimate.J_v, F, out.terms.force)
    controlled_force(gains, task, out.terms.force, F, out.F_c)
    for i in range(out.s.shape[0]):
        out.e_r[i] = task.r[i] - reference.r_d[i]
        out.e_r_dot[i] = task.r_dot[i] - reference.r_d_dot[i]
        out.e_Fc[i] = gains.controlled[i] * (out.F_c[i] - reference.F_cd[i])


@part
def sliding(gains, z, reference, out):
    """The compensator (9), the switching function (10) and the velocity that keeps it zero, (16)."""
    e_r, e_r_dot, eq = out.e_r, out.e_r_dot, out.equivalent
    A, F_1, F_2 = gains.A, gains.F_1, gains.F_2
    for i in range(z.shape[0]):
        fed_back = (
            row_times(gains.K_pz, i, e_r) + row_times(gains.K_vz, i, e_r_dot) + row_times(gains.K_fz, i, out.e_Fc)
        )
        out.z_dot[i] = A[i] * z[i] + fed_back  # (9)
        out.s[i] = e_r_dot[i] + F_1[i] * e_r[i] + F_2[i] * z[i]  # (10)
        eq.r_dot[i] = reference.r_d_dot[i] - F_1[i] * e_r[i] - F_2[i] * z[i]  # (16)
        eq.r_ddot[i] = reference.r_d_ddot[i] - F_1[i] * e_r_dot[i] - F_2[i] * out.z_dot[i]
    out.s_norm = norm(out.s)


@part
def joint_motion(task, r_dot, r_ddot, q_dot_drift, work, q_dot, q_ddot):
    """q_dot = J_q^-1 (r_dot - v_t) and q_ddot = J_q^-1 (r_ddot - J_q_dot q_dot_drift - v_t_dot), as in (25)."""
    for i in range(work.u.shape[0]):
        work.u[i] = r_dot[i] - task.v_t[i]
    times(task.J_q_inv, work.u, q_dot)
    for i in range(work.u.shape[0]):
        work.u[i] = r_ddot[i] - row_times(task.J_q_dot, i, q_dot_drift) - task.v_t_dot[i]
    times(task.J_q_inv, work.u, q_ddot)


@part
def gain(gains, deviation, task, estimate, q_dot, work, out):
    """d: the constant, or what (17) needs."""
    u, needed = gains.uncertainty, out.needed
    if gains.tight:
        tight_bound(u, deviation, estimate, task, q_dot, out.equivalent, work, needed)
    else:
        paper_bound(u, deviation, estimate, task, q_dot, out.equivalent, work, needed)
    needed.epsilon = gains.epsilon
    out.d = gains.d
    if gains.by_theorem:
        out.d = sum_of(needed)  # (17)


@part
def vsmrc_law(gains, z, reference, task, estimate, believed, q_dot, F, work, out):
    """One evaluation of (25) for the compensator state z (n,) and measured force F (3,) N."""
    errors(gains, reference, task, estimate, F, out)
    sliding(gains, z, reference, out)
    eq, terms = out.equivalent, out.terms
    joint_motion(task, eq.r_dot, eq.r_ddot, eq.q_dot, work, eq.q_dot, eq.q_ddot)
    gain(gains, believed.deviation, task, estimate, q_dot, work, out)

    times(believed.M_hat, eq.q_ddot, terms.inertia)
    times(believed.C_hat, eq.q_dot, terms.coriolis)
    copy(believed.G_hat, terms.gravity)
    switched = out.d * unit_factor(out.s_norm, gains.switching, gains.phi)  # d sigma(s) is s times this
    times(gains.K_s, out.s, work.u)
    for j in range(out.tau.shape[0]):
        linear, switching = 0.0, 0.0
        for i in range(out.tau.shape[0]):
            linear -= task.J_q[i, j] * work.u[i]
            switching -= task.J_q[i, j] * (switched * out.s[i])
        terms.linear[j], terms.switching[j] = linear, switching
    total(out)


@part
def total(out):
    """tau as the sum of its terms, (25)."""
    terms = out.terms
    for i in range(out.tau.shape[0]):
        predicted = terms.inertia[i] + terms.coriolis[i] + terms.gravity[i] + terms.force[i]
        out.tau[i] = predicted + terms.linear[i] + terms.switching[i]


@part
def computed_torque(gains, reference, task, believed, q_dot, work, out):
    """The baseline: the r_ddot that (8) asks for, by M_hat, C_hat, G_hat alone; z and s are carried along."""
    model, eq, terms = gains.model, out.equivalent, out.terms
    for i in range(q_dot.shape[0]):
        asked = row_times(model.B_m, i, out.e_r_dot) + row_times(model.K_m, i, out.e_r)
        work.u[i] = asked + row_times(model.K_f, i, out.e_Fc)
    for i in range(q_dot.shape[0]):
        eq.r_ddot[i] = reference.r_d_ddot[i] - row_times(model.M_m_inv, i, work.u)
    joint_motion(task, task.r_dot, eq.r_ddot, q_dot, work, eq.q_dot, eq.q_ddot)
    times(believed.M_hat, eq.q_ddot, terms.inertia)
    times(believed.C_hat, q_dot, terms.coriolis)
    for i in range(q_dot.shape[0]):
        terms.linear[i], terms.switching[i] = 0.0, 0.0
    out.d = 0.0
    total(out)


@part
def pd_gravity(gains, reference, task, work, out):
    """The simplest baseline: J_q^T (F_cd - K_m e_r - B_m e_r_dot) + G_hat; z and s are carried along."""
    model, eq, terms = gains.model, out.equivalent, out.terms
    for i in range(out.tau.shape[0]):
        work.u[i] = -row_times(model.K_m, i, out.e_r) - row_times(model.B_m, i, out.e_r_dot)
    transposed_times(task.J_q, work.u, terms.linear)
    transposed_times(task.J_q, reference.F_cd, terms.force)
    for i in range(out.tau.shape[0]):
        eq.q_ddot[i], terms.inertia[i], terms.coriolis[i], terms.switching[i] = 0.0, 0.0, 0.0, 0.0
    out.d = 0.0
    total(out)


@part
def control_law(gains, z, reference, task, estimate, believed, q_dot, F, work, out):
    """(25), or the baseline that `gains.law` names."""
    vsmrc_law(gains, z, reference, task, estimate, believed, q_dot, F, work, out)
    if gains.law == COMPUTED_TORQUE:
        computed_torque(gains, reference, task, believed, q_dot, work, out)
    elif gains.law == PD_GRAVITY:
        pd_gravity(gains, reference, task, work, out)


class _Question(NamedTuple):
    gains: Gains
    z: np.ndarray
    reference: Reference
    task: TaskSpace
    estimate: Estimate
    believed: FeedforwardModel
    q_dot: np.ndarray
    F: np.ndarray
    work: Scratch


@kernel
def _control_law_alone(question, answer):
    x = question[0]
    control_law(x.gains, x.z, x.reference, x.task, x.estimate, x.believed, x.q_dot, x.F, x.work, answer[0])


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
    law: ClassVar[Law] = Law.VSMRC

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
        return Gains(
            law=int(self.law),
            model=ModelMatrices(model.M_m, np.linalg.inv(model.M_m), model.B_m, model.K_m, model.K_f),
            A=np.diag(c.A),
            F_1=np.diag(c.F_1),
            F_2=np.diag(c.F_2),
            K_pz=c.K_pz,
            K_vz=c.K_vz,
            K_fz=c.K_fz,
            K_s=self.K_s,
            controlled=np.array(self.controlled, dtype=float),
            K_s_largest=float(np.linalg.eigvalsh(self.K_s)[-1]),
            K_s_smallest=float(np.linalg.eigvalsh(self.K_s)[0]),
            damping_rate=float(np.linalg.norm(np.linalg.solve(model.M_m, model.B_m) + c.A, 2)),
            m=self.m,
            by_theorem=self.d is None,
            d=float(self.d or 0.0),
            epsilon=float(self.epsilon),
            tight=self.bounds == "tight",
            switching=int(self.switching),
            phi=float(self.phi),
            uncertainty=self.uncertainty,
        )

    def following(self, model: TargetModel) -> Vsmrc:
        """The same law for another target model of as many coordinates: with (13) anew."""
        c = self.compensator
        return replace(self, model=model, compensator=Compensator.design(model, c.A, c.F_1, c.F_2))

    def evaluate(
        self,
        z: np.ndarray,
        reference: Reference,
        task: TaskSpace,
        estimate: Estimate,
        believed: FeedforwardModel,
        q_dot: np.ndarray,
        F: np.ndarray,
    ) -> ControlOutput:
        """(25) at one instant; z (n,) m/s, q_dot (n,) rad/s, F (3,) N measured force of the tool on the environment.

        believed: `FeedforwardModel.at(estimate)` when estimates are taken on-line, otherwise see Remark 3.
        """
        n = self.model.n
        work, answer = Scratch.zeros(n), Record(ControlOutput.zeros(n))
        question = _Question(self.gains, z, reference, task, estimate, believed, q_dot, F, work)
        _control_law_alone(Record(question).data, answer.data)
        return answer.read()
