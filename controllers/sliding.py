"""Quantities measured in every control period, whatever the law: the errors of (8), the compensator (9), the sliding
variable (10), the motion (16) that keeps it zero, and the gain (17) that outweighs the modelling errors."""

from __future__ import annotations

from controllers.bounds import terms_of_gain
from controllers.control_law import joint_acceleration, joint_velocity
from kernels import inline
from kernels.algebra import cross, dot, norm, row_times, torque_of_wrench, transposed_times


@inline
def measure(given, out):
    """Compute all quantities of this module. given: `LawInput`; out: `ControlOutput`."""
    gains, task, estimate, eq = given.gains, given.task, given.estimate, out.equivalent
    errors(gains, given.reference, task, estimate, given.F, out)
    sliding(gains, given.z, given.reference, out)
    joint_velocity(task, eq.r_dot, given.work, eq.q_dot)
    joint_acceleration(task, eq.r_ddot, eq.q_dot, given.work, eq.q_ddot)
    gain_needed(given, out)


@inline
def controlled_force(gains, task, tau_F, F, F_c):
    """Compute F_c (n,): the entries of F_r = J_q^-T J^T F of (5), J^T F = tau_F (n,) N m, in `controlled`; the first,
    one for each surface, are the multipliers, (39), (40)."""
    transposed_times(task.J_q_inv, tau_F, F_c)
    multipliers(task.normals, gains.surfaces, F, F_c)
    for i in range(F_c.shape[0]):
        F_c[i] *= gains.controlled[i]


@inline
def multipliers(normals, surfaces, F, found):
    """Compute the multipliers lambda of 0 to 3 surfaces whose force grad(Phi)^T lambda is nearest to that of
    the wrench F (6,), into the first entries of `found`. Friction along a single surface is not counted; of several,
    that along one is read as normal force of the others that it has a part along. normals: (3, 3), grad(Phi) in the
    first rows; they need not be orthogonal."""
    a, b, c = normals[0], normals[1], normals[2]
    if surfaces == 1:
        found[0] = dot(a, F) / dot(a, a)
    elif surfaces == 2:
        aa, ab, bb, aF, bF = dot(a, a), dot(a, b), dot(b, b), dot(a, F), dot(b, F)
        square = aa * bb - ab * ab
        found[0], found[1] = (bb * aF - ab * bF) / square, (aa * bF - ab * aF) / square
    elif surfaces == 3:
        across = cross(b, c)
        volume = dot(a, across)
        found[0], found[1], found[2] = (
            _along(across, F) / volume,
            _along(cross(c, a), F) / volume,
            _along(cross(a, b), F) / volume,
        )


@inline
def _along(direction, F):
    """Product of a direction, a tuple of three, and the force of a wrench (6,)."""
    return direction[0] * F[0] + direction[1] * F[1] + direction[2] * F[2]


@inline
def errors(gains, reference, task, estimate, F, out):
    """Compute e_r, e_r_dot and e_Fc, and with them J^T F = J_v^T f + J_w^T m of (2), and F_c: F_r = J_q^-T J^T F, so
    that F_r^T r_dot is the wrench's power on a surface at rest, whatever angles r has."""
    torque_of_wrench(estimate.J_v, estimate.J_w, F, out.J_F)
    controlled_force(gains, task, out.J_F, F, out.F_c)
    for i in range(out.s.shape[0]):
        out.e_r[i] = task.r[i] - reference.r_d[i]
        out.e_r_dot[i] = task.r_dot[i] - reference.r_d_dot[i]
        out.e_Fc[i] = gains.controlled[i] * (out.F_c[i] - reference.F_cd[i])


@inline
def sliding(gains, z, reference, out):
    """Compute the compensator (9), the sliding variable (10) and the velocity and acceleration that keep it zero,
    (16)."""
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


@inline
def gain_needed(given, out):
    """Compute the terms of (17), by the chosen bounds."""
    terms_of_gain(given, out.equivalent, given.work, out.needed)
    out.needed.epsilon = given.gains.epsilon
