"""Rigid bodies: the terms of a serial arm's equation of motion as compiled functions of records, without Pinocchio.

All quantities are in the world frame, spatial ones about its origin, linear part first. The constants of an arm come
from its `pin.Model` (`Chain.of`); tests/kernels/test_rigid_body.py compares every term with Pinocchio's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kernels import inline
from kernels.algebra import cross

if TYPE_CHECKING:
    import pinocchio as pin


class Chain(NamedTuple):
    """Constants of a serial arm of n joints on a fixed base; joint i carries link i.

    axes: (n, 3), unit vectors in the joints' frames.
    slides: (n,), 1 for a prismatic joint, 0 for a revolute one.
    rotations, positions: (n, 3, 3), (n, 3) m, the joints' placements on the links before, at q = 0.
    masses, levers, inertias: (n,) kg, (n, 3) m, (n, 3, 3) kg m^2 about the centres of mass, of the links.
    rotor: (n,) kg m^2 (kg for prismatic joints), the armature.
    gravity: (3,) m/s^2.
    """

    axes: np.ndarray
    slides: np.ndarray
    rotations: np.ndarray
    positions: np.ndarray
    masses: np.ndarray
    levers: np.ndarray
    inertias: np.ndarray
    rotor: np.ndarray
    gravity: np.ndarray
    total_mass: float

    @classmethod
    def of(cls, model: pin.Model) -> Chain:
        """Constants of a model; ValueError for one that is no serial chain of revolute and prismatic joints."""
        n = model.nv
        if model.nq != n or model.njoints != n + 1 or list(model.parents)[1:] != list(range(n)):
            raise ValueError("the arm must be a serial chain of joints with one coordinate each")
        subspaces = [_subspace(joint) for joint in list(model.joints)[1:]]
        links, placements = list(model.inertias)[1:], list(model.jointPlacements)[1:]
        slides = np.array([0.0 if subspace[3:].any() else 1.0 for subspace in subspaces])
        return cls(
            axes=np.array([s[:3] if slide else s[3:] for s, slide in zip(subspaces, slides, strict=True)]),
            slides=slides,
            rotations=np.array([placement.rotation for placement in placements]),
            positions=np.array([placement.translation for placement in placements]),
            masses=np.array([link.mass for link in links]),
            levers=np.array([link.lever for link in links]),
            inertias=np.array([link.inertia for link in links]),
            rotor=np.array(model.armature),
            gravity=np.array(model.gravity.linear),
            total_mass=float(sum(link.mass for link in links)),
        )


def same_geometry(first: Chain, second: Chain) -> bool:
    """Whether two arms have the same placements and Jacobians at the same q, to the last bit."""
    names = ("axes", "slides", "rotations", "positions")
    return all(np.array_equal(getattr(first, name), getattr(second, name)) for name in names)


def _subspace(joint: pin.JointModel) -> np.ndarray:
    """Motion of a joint per unit of its rate, (6,), in its own frame; ValueError for a joint that turns and slides."""
    data = joint.createData()
    joint.calc(data, np.zeros(1))
    subspace = np.array(data.S).ravel()
    if subspace[:3].any() and subspace[3:].any():
        raise ValueError(f"the joint {joint.shortname()} turns and slides at once; allowed: revolute, prismatic")
    return subspace


class Motion(NamedTuple):
    """Terms of an arm at one state, and the memory to compute them.

    Matrices other than R are transposed, so that they lie in memory as Pinocchio's, for which kernels are compiled.

    R, p: (n, 3, 3), (n, 3) m, orientation and position of the links' frames.
    J, J_dot: (n, 6), Jacobian of the last link and its derivative.
    velocity, acceleration, wrench: (n, 6), of the links; acceleration: without q_ddot, and with gravity's.
    inertia: (n, 10), mass, first moment (3), second moment xx, xy, xz, yy, yz, zz about the origin; of each link, or,
    once added up, of all links from this one on.
    momentum: (n, 3), linear. turning: (n, 3, 3), the angular block of the Christoffel factor.
    momenta, C, placements: (n, 6), (n, n), (4n, 3), see `nominal_model.Terms`.
    M: (n, n), with rotors. bias: (n,), C q_dot + G.
    """

    R: np.ndarray
    p: np.ndarray
    J: np.ndarray
    J_dot: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    wrench: np.ndarray
    inertia: np.ndarray
    momentum: np.ndarray
    turning: np.ndarray
    momenta: np.ndarray
    C: np.ndarray
    placements: np.ndarray
    M: np.ndarray
    bias: np.ndarray

    @classmethod
    def zeros(cls, n: int) -> Motion:
        """Motion of an arm of n joints."""
        turned, vectors, spatial, square = (np.zeros(shape) for shape in ((n, 3, 3), (n, 3), (n, 6), (n, n)))
        return cls(
            R=turned,
            p=vectors,
            J=spatial,
            J_dot=spatial,
            velocity=spatial,
            acceleration=spatial,
            wrench=spatial,
            inertia=np.zeros((n, 10)),
            momentum=vectors,
            turning=turned,
            momenta=spatial,
            C=square,
            placements=np.zeros((4 * n, 3)),
            M=square,
            bias=np.zeros(n),
        )


@inline
def forward_kinematics(chain, q, motion):
    """Compute R, p and J at q (n,)."""
    R, p, J = motion.R, motion.p, motion.J.T
    for i in range(q.shape[0]):
        x, y, z = chain.axes[i, 0], chain.axes[i, 1], chain.axes[i, 2]
        sliding = chain.slides[i] > 0.0
        angle, slid = (0.0, q[i]) if sliding else (q[i], 0.0)
        c, s = np.cos(angle), np.sin(angle)
        u = 1.0 - c
        first = (c + x * x * u, y * x * u + z * s, z * x * u - y * s)  # columns of the joint's rotation
        second = (x * y * u - z * s, c + y * y * u, z * y * u + x * s)
        third = (x * z * u + y * s, y * z * u - x * s, c + z * z * u)
        fixed, step = chain.rotations[i], chain.positions[i]
        for a in range(3):
            if i == 0:
                before, b0, b1, b2 = step[a], fixed[a, 0], fixed[a, 1], fixed[a, 2]
            else:
                r0, r1, r2 = R[i - 1, a, 0], R[i - 1, a, 1], R[i - 1, a, 2]
                before = p[i - 1, a] + r0 * step[0] + r1 * step[1] + r2 * step[2]
                b0 = r0 * fixed[0, 0] + r1 * fixed[1, 0] + r2 * fixed[2, 0]
                b1 = r0 * fixed[0, 1] + r1 * fixed[1, 1] + r2 * fixed[2, 1]
                b2 = r0 * fixed[0, 2] + r1 * fixed[1, 2] + r2 * fixed[2, 2]
            p[i, a] = before + slid * (b0 * x + b1 * y + b2 * z)
            R[i, a, 0] = b0 * first[0] + b1 * first[1] + b2 * first[2]
            R[i, a, 1] = b0 * second[0] + b1 * second[1] + b2 * second[2]
            R[i, a, 2] = b0 * third[0] + b1 * third[1] + b2 * third[2]
        axis = (
            R[i, 0, 0] * x + R[i, 0, 1] * y + R[i, 0, 2] * z,
            R[i, 1, 0] * x + R[i, 1, 1] * y + R[i, 1, 2] * z,
            R[i, 2, 0] * x + R[i, 2, 1] * y + R[i, 2, 2] * z,
        )
        around = cross(p[i], axis)
        for a in range(3):
            J[a, i] = axis[a] if sliding else around[a]
            J[3 + a, i] = 0.0 if sliding else axis[a]


@inline
def copy_kinematics(other, motion):
    """Copy R, p and J from the motion of another arm of the same geometry."""
    for i in range(motion.p.shape[0]):
        for a in range(3):
            motion.p[i, a] = other.p[i, a]
            for b in range(3):
                motion.R[i, a, b] = other.R[i, a, b]
        for a in range(6):
            motion.J[i, a] = other.J[i, a]


@inline
def jacobian_rate(q_dot, motion):
    """Compute the links' velocities and J_dot for q_dot (n,), after `forward_kinematics`."""
    J, J_dot, v = motion.J.T, motion.J_dot.T, motion.velocity
    for i in range(q_dot.shape[0]):
        for a in range(6):
            before = 0.0 if i == 0 else v[i - 1, a]
            v[i, a] = before + J[a, i] * q_dot[i]
        speed, spin = (v[i, 0], v[i, 1], v[i, 2]), (v[i, 3], v[i, 4], v[i, 5])
        along, about = (J[0, i], J[1, i], J[2, i]), (J[3, i], J[4, i], J[5, i])
        turned, moved, tilted = cross(spin, along), cross(speed, about), cross(spin, about)
        for a in range(3):
            J_dot[a, i], J_dot[3 + a, i] = turned[a] + moved[a], tilted[a]


@inline
def link_inertias(chain, motion):
    """Compute the inertia of each link, after `forward_kinematics`."""
    R, p, Y = motion.R, motion.p, motion.inertia
    for i in range(p.shape[0]):
        m, lever, own = chain.masses[i], chain.levers[i], chain.inertias[i]
        for a in range(3):
            Y[i, 1 + a] = p[i, a] + R[i, a, 0] * lever[0] + R[i, a, 1] * lever[1] + R[i, a, 2] * lever[2]
        x, y, z = Y[i, 1], Y[i, 2], Y[i, 3]
        Y[i, 0], Y[i, 1], Y[i, 2], Y[i, 3] = m, m * x, m * y, m * z
        k = 4
        for a in range(3):
            t0 = R[i, a, 0] * own[0, 0] + R[i, a, 1] * own[1, 0] + R[i, a, 2] * own[2, 0]
            t1 = R[i, a, 0] * own[0, 1] + R[i, a, 1] * own[1, 1] + R[i, a, 2] * own[2, 1]
            t2 = R[i, a, 0] * own[0, 2] + R[i, a, 1] * own[1, 2] + R[i, a, 2] * own[2, 2]
            for b in range(a, 3):
                Y[i, k] = t0 * R[i, b, 0] + t1 * R[i, b, 1] + t2 * R[i, b, 2]
                k += 1
        Y[i, 4] += m * (y * y + z * z)
        Y[i, 5] -= m * x * y
        Y[i, 6] -= m * x * z
        Y[i, 7] += m * (x * x + z * z)
        Y[i, 8] -= m * y * z
        Y[i, 9] += m * (x * x + y * y)


@inline
def _times_inertia(Y, i, v):
    """Momentum (6) of the inertia in row i that moves with v (6)."""
    m, h = Y[i, 0], (Y[i, 1], Y[i, 2], Y[i, 3])
    speed, spin = (v[0], v[1], v[2]), (v[3], v[4], v[5])
    turned, moved = cross(h, spin), cross(h, speed)
    return (
        m * v[0] - turned[0],
        m * v[1] - turned[1],
        m * v[2] - turned[2],
        moved[0] + Y[i, 4] * v[3] + Y[i, 5] * v[4] + Y[i, 6] * v[5],
        moved[1] + Y[i, 5] * v[3] + Y[i, 7] * v[4] + Y[i, 8] * v[5],
        moved[2] + Y[i, 6] * v[3] + Y[i, 8] * v[4] + Y[i, 9] * v[5],
    )


@inline
def _column(A, i):
    return A[0, i], A[1, i], A[2, i], A[3, i], A[4, i], A[5, i]


@inline
def _along(A, j, x):
    """Scalar product of column j of A (6, n) and x (6,)."""
    return A[0, j] * x[0] + A[1, j] * x[1] + A[2, j] * x[2] + A[3, j] * x[3] + A[4, j] * x[4] + A[5, j] * x[5]


@inline
def _christoffel_factors(motion):
    """Compute momentum and turning of each link: with the linear momentum l, the first moment h and the second moment
    E, the factor whose sums give the Christoffel matrix is 0 in its linear columns and, in its angular ones, -[l] above
    v.h 1 - v h^T - [omega] E."""
    Y, v, momentum, turning = motion.inertia, motion.velocity, motion.momentum, motion.turning
    for i in range(v.shape[0]):
        h, speed, spin = (Y[i, 1], Y[i, 2], Y[i, 3]), (v[i, 0], v[i, 1], v[i, 2]), (v[i, 3], v[i, 4], v[i, 5])
        carried = cross(spin, h)
        half = 0.5 * (Y[i, 4] + Y[i, 7] + Y[i, 9])
        E = (
            (half - Y[i, 4], -Y[i, 5], -Y[i, 6]),
            (-Y[i, 5], half - Y[i, 7], -Y[i, 8]),
            (-Y[i, 6], -Y[i, 8], half - Y[i, 9]),
        )
        away = speed[0] * h[0] + speed[1] * h[1] + speed[2] * h[2]
        for b in range(3):
            turned = cross(spin, E[b])
            for a in range(3):
                turning[i, a, b] = (away if a == b else 0.0) - speed[a] * h[b] - turned[a]
            momentum[i, b] = Y[i, 0] * speed[b] + carried[b]


@inline
def estimated_terms(chain, motion):
    """Compute momenta, C and placements, after `forward_kinematics`, `jacobian_rate` and `link_inertias`; adds the
    inertias up."""
    J, J_dot, Y, C, momenta = motion.J.T, motion.J_dot.T, motion.inertia, motion.C.T, motion.momenta.T
    momentum, turning, placements, n = motion.momentum, motion.turning, motion.placements.T, motion.bias.shape[0]
    _christoffel_factors(motion)
    for i in range(n - 1, -1, -1):
        share = 1.0 / chain.total_mass
        for a in range(3):
            placements[a, 4 * i] = motion.p[i, a] * share
            for b in range(3):
                placements[a, 4 * i + 1 + b] = motion.R[i, a, b] * share
        if i < n - 1:
            for k in range(10):
                Y[i, k] += Y[i + 1, k]
            for a in range(3):
                momentum[i, a] += momentum[i + 1, a]
                for b in range(3):
                    turning[i, a, b] += turning[i + 1, a, b]
        carried, changed = _times_inertia(Y, i, _column(J, i)), _times_inertia(Y, i, _column(J_dot, i))
        l, T = momentum[i], turning[i]
        along, about = (J[0, i], J[1, i], J[2, i]), (J[3, i], J[4, i], J[5, i])
        above, left = cross(about, l), cross(l, along)
        column = (
            changed[0] + above[0],
            changed[1] + above[1],
            changed[2] + above[2],
            changed[3] + T[0, 0] * about[0] + T[0, 1] * about[1] + T[0, 2] * about[2],
            changed[4] + T[1, 0] * about[0] + T[1, 1] * about[1] + T[1, 2] * about[2],
            changed[5] + T[2, 0] * about[0] + T[2, 1] * about[1] + T[2, 2] * about[2],
        )
        row = (
            left[0] + T[0, 0] * about[0] + T[1, 0] * about[1] + T[2, 0] * about[2],
            left[1] + T[0, 1] * about[0] + T[1, 1] * about[1] + T[2, 1] * about[2],
            left[2] + T[0, 2] * about[0] + T[1, 2] * about[1] + T[2, 2] * about[2],
        )
        for a in range(6):
            momenta[a, i] = carried[a]
        for j in range(i + 1):
            C[j, i] = _along(J, j, column)
            if j < i:
                C[i, j] = _along(J_dot, j, carried) + row[0] * J[3, j] + row[1] * J[4, j] + row[2] * J[5, j]


@inline
def bias_torque(chain, q_dot, motion):
    """Compute bias = C q_dot + G, after `forward_kinematics`, `jacobian_rate` and `link_inertias`."""
    J, J_dot, Y, v = motion.J.T, motion.J_dot.T, motion.inertia, motion.velocity
    acceleration, wrench, n = motion.acceleration, motion.wrench, q_dot.shape[0]
    for i in range(n):
        for a in range(6):
            before = acceleration[i - 1, a] if i > 0 else (-chain.gravity[a] if a < 3 else 0.0)
            acceleration[i, a] = before + J_dot[a, i] * q_dot[i]
        force, momentum = _times_inertia(Y, i, acceleration[i]), _times_inertia(Y, i, v[i])
        speed, spin = (v[i, 0], v[i, 1], v[i, 2]), (v[i, 3], v[i, 4], v[i, 5])
        linear, angular = (momentum[0], momentum[1], momentum[2]), (momentum[3], momentum[4], momentum[5])
        pushed, turned, carried = cross(spin, linear), cross(spin, angular), cross(speed, linear)
        for a in range(3):
            wrench[i, a] = force[a] + pushed[a]
            wrench[i, 3 + a] = force[3 + a] + turned[a] + carried[a]
    for i in range(n - 1, -1, -1):
        if i < n - 1:
            for a in range(6):
                wrench[i, a] += wrench[i + 1, a]
        motion.bias[i] = _along(J, i, wrench[i])


@inline
def mass_matrix(chain, motion):
    """Compute the mass matrix M, after `forward_kinematics` and `link_inertias`; adds the inertias up."""
    J, Y, M, n = motion.J.T, motion.inertia, motion.M, motion.bias.shape[0]
    for i in range(n - 1, -1, -1):
        if i < n - 1:
            for k in range(10):
                Y[i, k] += Y[i + 1, k]
        carried = _times_inertia(Y, i, _column(J, i))
        for j in range(i + 1):
            M[i, j] = M[j, i] = _along(J, j, carried)
        M[i, i] += chain.rotor[i]
