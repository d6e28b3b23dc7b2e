"""Error of a torque that is held over one control period: what the law would have changed meanwhile, the w of
`docs/theory.md`, section 1."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kernels import inline
from kernels.algebra import norm, row_times, times, torque_of_wrench, transposed_times


class Held(NamedTuple):
    """Quantities of the previous period.
    model: (n,) N m, the terms of (25) without the robust ones.
    z_dot: (n,) m/s^2.
    r: (n,) m, of the arm; s_norm: m/s.
    push: (6,), a wrench.
    r_d, r_d_dot, r_d_ddot: (n,), of the reference, m, m/s, m/s^2.
    known: whether there is a period before under the same law.
    placed: whether there is a period before, under any law, so that r is known."""

    model: np.ndarray
    z_dot: np.ndarray
    r: np.ndarray
    s_norm: float
    push: np.ndarray
    r_d: np.ndarray
    r_d_dot: np.ndarray
    r_d_ddot: np.ndarray
    known: bool
    placed: bool

    @classmethod
    def zeros(cls, n: int) -> Held:
        """Quantities for n coordinates, before the first period."""
        v = np.zeros(n)
        push = np.zeros(6)
        return cls(
            model=v, z_dot=v, r=v, s_norm=0.0, push=push, r_d=v, r_d_dot=v, r_d_ddot=v, known=False, placed=False
        )


@inline
def held_error(gains, feedforward, task, estimate, F_true, output, held, scratch):
    """Change of (25) without its robust terms during the period before, in task space, N.

    F_true: (6,), the wrench at the period's end, or its mean over the period. F_2 z_dot is not included: z changes
    evenly within a period, so that r_eq_ddot contains just that part.
    """
    work, n = scratch.work, task.r.shape[0]
    for i in range(n):
        work.u[i] = gains.F_2[i] * (output.z_dot[i] - held.z_dot[i])
    times(task.J_q_inv, work.u, scratch.e_dot)
    torque_of_wrench(estimate.J_v, estimate.J_w, F_true, scratch.torque)
    terms = output.terms
    for i in range(n):
        model = terms.inertia[i] + row_times(feedforward.M_hat, i, scratch.e_dot) + terms.coriolis[i] + terms.gravity[i]
        scratch.torque[i] += model - held.model[i]
    transposed_times(task.J_q_inv, scratch.torque, work.u)
    return norm(work.u)


@inline
def reference_jump(gains, reference, held, period):
    """Jump of s (m/s) caused by a step of r_d or r_d_dot between two samples."""
    square, half = 0.0, 0.5 * period
    for i in range(held.r_d.shape[0]):
        moved = reference.r_d[i] - held.r_d[i] - half * (reference.r_d_dot[i] + held.r_d_dot[i])
        turned = reference.r_d_dot[i] - held.r_d_dot[i] - half * (reference.r_d_ddot[i] + held.r_d_ddot[i])
        square += (turned + gains.F_1[i] * moved) ** 2
    return np.sqrt(square)


@inline
def push_changed(push, held, allowed):
    """Whether the push on the tool differs from that of the previous period by more than `allowed` (N), so that the
    band must be recomputed."""
    square = 0.0
    for a in range(push.shape[0]):
        square += (push[a] - held.push[a]) ** 2
    return square > allowed**2
