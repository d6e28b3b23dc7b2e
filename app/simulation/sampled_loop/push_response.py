"""Response of the tool to a push, in linear terms: that of the target model, and that of the sampled loop.

A push is a force along an axis through the tool point, or a moment about one. It is held over each control period, and
the speed is the tool's mean one over it, along the axis or about it, so that push times speed is the work done in the
period: where the Hermitian part of the admittance has no negative eigenvalue, a sinusoidal push gets no energy from the
arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from app.simulation.sampled_loop.sampled_frequencies import SampledFrequencies

ROUNDING_ADMITTANCE = 1e-12  # m/s per N, or rad/s per N m: an admittance that is rounding
RIGID = 1e-9  # m per N, or rad per N m: a compliance below this counts as none
ROUNDING = 1e-9  # share of the admittance's largest entry by which an eigenvalue may be below zero, for rounding


class PushKind(NamedTuple):
    """Kind of a push.
    unit: of the push.
    motion: name of the tool's motion.
    motion_unit, impedance_unit: units of that motion, and of the impedance that the push meets."""

    name: str
    unit: str
    motion: str
    motion_unit: str
    impedance_unit: str


FORCE = PushKind("force", "N", "way", "m", "N·s/m")
MOMENT = PushKind("moment", "N·m", "turn", "rad", "N·m·s/rad")


@dataclass(frozen=True)
class PushAxis:
    """Axis through the tool point of a push.
    name: of the axis, or of the angle that changes when the tool turns about it.
    words: the name with its preposition.
    kind: a force along the axis, or a moment about it.
    wrench: (6,), the unit push in the world; times the tool's velocity and angular velocity it is the speed."""

    name: str
    words: str
    kind: PushKind
    wrench: np.ndarray


@dataclass(frozen=True)
class PushResponse(SampledFrequencies):
    """Response at rest at one posture, for pushes along p axes, forces first. A unit is N for a force and N m for a
    moment; speeds and ways are m/s and m, or rad/s and rad.

    period: s.
    l: characteristic length, m, which makes speeds and turns comparable.
    A (k, k), B (k, p): deviations x from rest, one control period on, A x + B F, with the pushes F.
    C: (p, k), place of the tool along the axes, from x.
    M, D, K: (j, j) kg, N s/m, N/m, of the target model against the true contact, in the directions in which the arm can
    move.
    pushed: (j, p), force on the model per push; place: (p, j), place of the tool from its coordinates.
    """

    axes: tuple[PushAxis, ...]
    l: float
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    M: np.ndarray
    D: np.ndarray
    K: np.ndarray
    pushed: np.ndarray
    place: np.ndarray

    @property
    def wrenches(self) -> np.ndarray:
        """Unit pushes (p, 6) in the world."""
        return np.array([axis.wrench for axis in self.axes])

    @property
    def kinds(self) -> dict[PushKind, list[int]]:
        """Numbers of the axes of each kind of push that there is."""
        return {kind: found for kind in (FORCE, MOMENT) if (found := self._of(kind))}

    def _of(self, kind: PushKind) -> list[int]:
        return [k for k, axis in enumerate(self.axes) if axis.kind == kind]

    def in_metres(self, admittance: np.ndarray) -> np.ndarray:
        """Admittance (N, p, p) in m/s per N, where an angle counts l times, and a moment 1/l times."""
        scale = np.array([1.0 if axis.kind == FORCE else self.l for axis in self.axes])
        return scale[:, None] * admittance * scale

    def step(self, seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Way of the tool along each axis under a unit push along it from t = 0 on: times (N,) s, that of the sampled
        loop (N, p), and that of the target model."""
        from scipy.signal import StateSpace, step  # takes 0.4 s and 30 MB: a page that draws none need not load it

        times = self.period * np.arange(round(seconds / self.period) + 1)
        p = len(self.axes)
        sampled, target = np.empty((len(times), p)), np.empty((len(times), p))
        rates = np.linalg.solve(self.M, np.hstack([-self.K, -self.D]))
        drift = np.vstack([np.eye(len(self.M), 2 * len(self.M), len(self.M)), rates])
        for axis in range(p):
            x = np.zeros(len(self.A))
            for k in range(len(times)):
                sampled[k, axis] = self.C[axis] @ x
                x = self.A @ x + self.B[:, axis]
            force = np.concatenate([np.zeros(len(self.M)), np.linalg.solve(self.M, self.pushed[:, axis])])
            place = np.concatenate([self.place[axis], np.zeros(len(self.M))])
            model = StateSpace(drift, force[:, None], place[None], np.zeros((1, 1)))
            target[:, axis] = step(model, T=times)[1]
        return times, sampled, target

    def admittance(self, frequency: np.ndarray) -> np.ndarray:
        """Admittance (N, p, p) of the sampled loop at frequencies (N,) Hz up to `highest`."""
        z = np.exp(2j * np.pi * frequency * self.period)[:, None, None]
        x = np.linalg.solve(z * np.eye(len(self.A)) - self.A, np.broadcast_to(self.B, (len(z), *self.B.shape)))
        return (z - 1.0) / self.period * (self.C @ x)

    def target(self, frequency: np.ndarray) -> np.ndarray:
        """Admittance (N, p, p) of the target model: s (M s^2 + D s + K)^-1; zero for a model that feels no force."""
        s = 2j * np.pi * frequency[:, None, None]
        forces = np.broadcast_to(self.pushed, (len(s), *self.pushed.shape))
        return s * (self.place @ np.linalg.solve(self.M * s**2 + self.D * s + self.K, forces))


def block(admittance: np.ndarray, axes: list[int]) -> np.ndarray:
    """Admittance (N, k, k) for pushes along k of the axes. admittance: (N, p, p)."""
    return admittance[:, axes][:, :, axes]


def along_axes(frequency: np.ndarray, admittance: np.ndarray) -> np.ndarray:
    """Impedance (N, p) that a push along each axis meets while the others are free; infinite for an axis along which
    nothing moves. frequency: (N,) Hz. admittance: (N, p, p)."""
    return _impedance(frequency, np.abs(np.diagonal(admittance, axis1=1, axis2=2)))


def largest_and_smallest(frequency: np.ndarray, admittance: np.ndarray) -> np.ndarray:
    """Largest and smallest impedance (N, 2) over all directions: one over the admittance's singular values; infinite
    where nothing moves. frequency: (N,) Hz. admittance: (N, p, p), of one kind of push."""
    return _impedance(frequency, np.linalg.svd(admittance, compute_uv=False)[:, [-1, 0]])


def _impedance(frequency: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Impedance (N, k) of admittances of this size (N, k); infinite in a column of which no compliance counts, since
    all of it is rounding."""
    yields = (size / (2.0 * np.pi * frequency[:, None])).max(axis=0, initial=0.0) > RIGID
    return np.divide(1.0, size, out=np.full_like(size, np.inf), where=yields & (size > 0.0))


def passive(admittance: np.ndarray) -> np.ndarray:
    """Mask (N,) of the frequencies at which no sinusoidal push gets energy from the arm. admittance: (N, p, p)."""
    hermitian = 0.5 * (admittance + np.conj(np.swapaxes(admittance, 1, 2)))
    least = np.linalg.eigvalsh(hermitian)[:, 0]
    return least >= -ROUNDING * np.abs(admittance).max() - ROUNDING_ADMITTANCE
