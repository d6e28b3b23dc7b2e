"""Interface of the control laws: their inputs, their output, and the description of a law; the laws are in
`controllers.laws`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from controllers.bounds import Equivalent, RequiredGain, Uncertainty
from controllers.nominal_model import Estimate
from controllers.reference_estimates import FeedforwardModel
from controllers.task_space import Scratch, TaskSpace
from kernels import compiled, inline
from kernels.algebra import row_times, times
from parameters import Parameter


class Reference(NamedTuple):
    """Reference of the task coordinates.
    r_d, r_d_dot, r_d_ddot: (n,) m, m/s and m/s^2.
    F_cd: (n,) N, desired value of F_c."""

    r_d: np.ndarray
    r_d_dot: np.ndarray
    r_d_ddot: np.ndarray
    F_cd: np.ndarray

    @classmethod
    def zeros(cls, n: int) -> Reference:
        """Reference of n coordinates."""
        return cls(*4 * (np.zeros(n),))


class TorqueTerms(NamedTuple):
    """The terms of a torque, each (n,) N m, named after those of (25); tau is their sum."""

    inertia: np.ndarray  # M_hat q_ddot
    coriolis: np.ndarray  # C_hat q_dot
    gravity: np.ndarray  # G_hat
    force: np.ndarray  # J^T F
    linear: np.ndarray  # -J_q^T K_s s
    switching: np.ndarray  # -J_q^T d sigma(s)


class ControlOutput(NamedTuple):
    """Results of one control period: the law computes `terms`, d and q_ddot, all others are the same under every law.

    tau: (n,) N m, commanded torque: the sum of `terms`, (25).
    e_r, e_r_dot: (n,) m and m/s, r - r_d and its rate, (8).
    F_c: (n,) N, controlled part of F_r, (40).
    e_Fc: (n,) N, F_c - F_cd.
    J_F: (n,) N m, J^T F of the measured wrench.
    z_dot: (n,) m/s^2, (9).
    s: (n,) m/s, (10).
    s_norm: m/s, ||s||.
    d: N, gain of the switching term; 0 for a law without one.
    q_ddot: (n,) rad/s^2, acceleration of the inertia term; 0 for a law without one.
    needed: terms of (17).
    equivalent: motion on which s stays 0, (16).
    """

    tau: np.ndarray
    terms: TorqueTerms
    e_r: np.ndarray
    e_r_dot: np.ndarray
    F_c: np.ndarray
    e_Fc: np.ndarray
    J_F: np.ndarray
    z_dot: np.ndarray
    s: np.ndarray
    s_norm: float
    d: float
    q_ddot: np.ndarray
    needed: RequiredGain
    equivalent: Equivalent

    @classmethod
    def zeros(cls, n: int) -> ControlOutput:
        """Output of n coordinates."""
        v = np.zeros(n)
        terms = TorqueTerms(*6 * (v,))
        return cls(v, terms, v, v, v, v, v, v, v, 0.0, 0.0, v, RequiredGain.zeros(), Equivalent.zeros(n))


class ModelMatrices(NamedTuple):
    """Matrices of (8): M_m, its inverse, B_m, K_m, K_f, each (n, n)."""

    M_m: np.ndarray
    M_m_inv: np.ndarray
    B_m: np.ndarray
    K_m: np.ndarray
    K_f: np.ndarray


class Gains(NamedTuple):
    """Parameters of (8) to (17), K_s, d and epsilon of (15) among them: see `Compensator` and `Controller`.

    law: number of the law, see `laws.table.number_of`.
    model: matrices of (8).
    A, F_1, F_2: (n,) 1/s, 1/s and 1, the diagonals of (9), (10).
    K_pz, K_vz, K_fz: (n, n), of (9), from (13).
    K_s: (n, n) kg/s, of (15); K_s_largest, K_s_smallest: its extreme eigenvalues.
    controlled: (n,), 1 for each coordinate whose force is fed back, else 0.
    surfaces: number of surfaces among the task coordinates.
    damping_rate: 1/s, ||M_m^-1 B_m + A||, the gain from e_r_dot to r_eq_ddot.
    by_theorem: whether d is what (17) needs, else the constant d, N.
    epsilon: N, of (17).
    tight: whether the tight bounds are used, else those of (7).
    switching: number of the switching function; layer: m/s, of its boundary layer, inf without one; reaching_share: 1,
    of epsilon, see `SwitchingFunction.reaching_share`.
    uncertainty: what is declared of the true arm.
    """

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
    surfaces: int
    by_theorem: bool
    d: float
    epsilon: float
    tight: bool
    switching: int
    layer: float
    reaching_share: float
    uncertainty: Uncertainty


class LawInput(NamedTuple):
    """Input of a control law.
    gains: those of (8) to (17).
    parameters: the law's own, by name (`ControlLaw.parameters`); see `no_parameters` for a law without any.
    reference: r_d and F_cd.
    task: task coordinates.
    estimate: estimates of the arm at q.
    feedforward: M_hat, C_hat, G_hat at q, or those of Remark 3.
    z: (n,) m/s, of (9).
    q, q_dot: (n,) rad and rad/s.
    F: (6,) N and N m, F of (2) as measured: the wrench of the tool on the environment at the tool point, along the
    world's axes, force first.
    work: memory for intermediate results."""

    gains: Gains
    parameters: Any
    reference: Reference
    task: TaskSpace
    estimate: Estimate
    feedforward: FeedforwardModel
    z: np.ndarray
    q: np.ndarray
    q_dot: np.ndarray
    F: np.ndarray
    work: Scratch


@inline
def no_parameters(gains):
    """Parameters for a law that has none of its own: the gains stand in for them, so that no record is without
    fields."""
    return gains


# What the torque of a law may depend on, in words, by the name in `ControlLaw.told`, besides gains and reference.
TOLD: Mapping[str, str] = MappingProxyType(
    {
        "model": "M̂ and Ĉ",
        "gravity": "Ĝ",
        "bounds": "the declared bounds",
        "force": "the measured force",
        "rates": "the velocities",
        "compensator": "z and s",
    }
)


@dataclass(frozen=True)
class ControlLaw:
    """A control law.

    kind: its name in a scenario; title: its name on the page; about: a sentence or two for the page and for captions.
    torque: `torque(given, out)` reads a `LawInput` and writes `out.terms`, and `out.d` and `out.q_ddot` if the law has
    them; terms that it does not write are zero. Decorated with `kernels.inline` or `kernels.allocating` it is compiled,
    else it is plain numpy.
    told: what its torque depends on, names of `TOLD`: "model" stands for M_hat and C_hat, "gravity" for G_hat,
    "bounds" for `Gains.uncertainty` and `ControlOutput.needed`, "force" for the measured F and F_c, "rates" for q_dot
    and the rates that follow from it, "compensator" for z and s of (9) and (10). A test checks this of the laws of the
    program.
    terms: name of each term of its torque that it writes, for the legends of plots, by the field of `TorqueTerms`;
    None for the fields' own names.
    robust: whether the law is (25), the law of Theorem 1.
    states: gives the length k of the law's own state for n coordinates; then the torque is `torque(given, out, x,
    x_dot)`, which writes the rate x_dot (k,) of x (k,); x is zero at the start and when the law is chosen.
    """

    kind: str
    title: str
    about: str
    torque: Callable[..., None]
    told: tuple[str, ...] = tuple(TOLD)
    terms: Mapping[str, str] | None = field(default=None, hash=False)
    robust: bool = False
    states: Callable[[int], int] | None = None
    parameters: tuple[Parameter, ...] = ()

    def at_rest(self, n: int) -> np.ndarray:
        """Initial value of the law's own state (k,), for n coordinates."""
        return np.zeros(0 if self.states is None else self.states(n))

    @property
    def feels_force(self) -> bool:
        """Whether the measured force acts on the torque, also where it does so through z (9) alone."""
        return "force" in self.told or self.compensated

    @property
    def compensated(self) -> bool:
        """Whether z and s act on the torque."""
        return "compensator" in self.told

    @property
    def named_terms(self) -> Mapping[str, str]:
        """Name of each term of its torque, by the field of `TorqueTerms`."""
        return dict(zip(TorqueTerms._fields, TorqueTerms._fields, strict=True)) if self.terms is None else self.terms

    @property
    def told_in_words(self) -> str:
        """Sentence on what the law is told of and what not."""
        known = ", ".join(words for name, words in TOLD.items() if name in self.told) or "gains and reference alone"
        unknown = ", ".join(words for name, words in TOLD.items() if name not in self.told)
        return f"Its torque depends on {known}" + (f"; not on {unknown}." if unknown else ".")

    @property
    def compiled(self) -> bool:
        """Whether its torque is a compiled function."""
        return compiled(self.torque)


@inline
def joint_velocity(task, r_dot, work, q_dot):
    """Compute q_dot = J_q^-1 (r_dot - v_t), as in (25)."""
    for i in range(work.u.shape[0]):
        work.u[i] = r_dot[i] - task.v_t[i]
    times(task.J_q_inv, work.u, q_dot)


@inline
def joint_acceleration(task, r_ddot, q_dot, work, q_ddot):
    """Compute q_ddot = J_q^-1 (r_ddot - J_q_dot q_dot - v_t_dot), as in (25); q_ddot may be r_ddot."""
    for i in range(work.u.shape[0]):
        work.u[i] = r_ddot[i] - row_times(task.J_q_dot, i, q_dot) - task.v_t_dot[i]
    times(task.J_q_inv, work.u, q_ddot)


@inline
def clear(out):
    """Set all terms of the torque to zero: a law writes only the terms that it has."""
    terms = out.terms
    out.d = 0.0
    for i in range(out.tau.shape[0]):
        out.q_ddot[i], terms.inertia[i], terms.coriolis[i], terms.gravity[i] = 0.0, 0.0, 0.0, 0.0
        terms.force[i], terms.linear[i], terms.switching[i] = 0.0, 0.0, 0.0


@inline
def add_up(out):
    """Compute tau, the sum of its terms, (25)."""
    terms = out.terms
    for i in range(out.tau.shape[0]):
        predicted = terms.inertia[i] + terms.coriolis[i] + terms.gravity[i] + terms.force[i]
        out.tau[i] = predicted + terms.linear[i] + terms.switching[i]
