"""Resolution of stiff parts by the plant's step: each integrator on its linear test equation.

Along one direction the arm is a mass on a spring and a damper, x_ddot = -Y (K x + B x_dot), with its mobility Y there
(1/kg): Y = grad(phi) J_v M^-1 J_v^T grad(phi)^T along the normal, Y / (1 + M_e Y) where the contact has a mass (28).
One step of an integrator is a matrix; deviations grow, whatever the controller does, where its spectral radius exceeds
1. Without damping that is so from h omega > 2 on for semi-implicit Euler, from h omega > 2.83 on for RK4.

Coulomb friction is not judged: it is bounded, so that a step that is too long makes it chatter but nothing explode.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, combinations
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from environments.contact import Contact
from environments.contact_kinds import ContactKind
from environments.coupled_surfaces import EnvironmentMatrices
from environments.integrators import INTEGRATORS, IntegratorName
from environments.truth import Truth

ROUNDING = 1e-7  # of the radius of an undamped oscillator, which is 1


class Mobility(NamedTuple):
    """Largest acceleration per force: of the tool along grad(phi) and across it, 1/kg; of the joints, 1/(kg m^2)."""

    normal: float
    tangential: float
    joints: float

    def at_most_for(self, true: pin.Model, believed: pin.Model) -> Mobility | None:
        """Upper bound of the true arm's mobility, where this is the believed arm's; None where there is none.

        M is a sum of J^T I J over the links' spatial inertias I (6, 6), and of rotors. With f the least factor by which
        one of these differs, the true M is at least f times the believed one.
        """
        rotors = np.divide(true.armature, believed.armature, out=np.ones(true.nv), where=believed.armature > 0.0)
        least = float(rotors.min())
        for a, b in zip(list(true.inertias)[1:], list(believed.inertias)[1:], strict=True):
            least = min(least, _least_factor(a.matrix(), b.matrix()))
        return Mobility(*(value / least for value in self)) if least > 0.0 else None


def mobilities(M: np.ndarray, J_v: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Numbers of `Mobility` in N states, (N, 3): M (N, n, n) kg m^2 of the true arm, J_v (N, 3, n) of its tool, normals
    (N, S, 3) of S surfaces: grad(phi)."""
    compliance = (J_v @ np.linalg.solve(M, J_v.swapaxes(1, 2)))[:, None]
    along = normals[..., :, None] * normals[..., None, :]
    across = np.eye(3) - along / np.square(normals).sum(axis=-1)[..., None, None]
    tangential = np.linalg.eigvalsh(across @ compliance @ across)[..., -1].max(axis=1)
    joints = 1.0 / np.linalg.eigvalsh(M)[:, 0]
    return np.array([(compliance * along).sum(axis=(2, 3)).max(axis=1), tangential, joints]).T


def _least_factor(I: np.ndarray, of: np.ndarray) -> float:
    """Largest f with I - f times the other spatial inertia positive semidefinite, both (6, 6); a point mass has no
    inertia about some of its axes."""
    squares, axes = np.linalg.eigh(I)
    nonzero = squares > ROUNDING * squares[-1]
    if not np.abs(of @ axes[:, ~nonzero]).max(initial=0.0) <= ROUNDING * squares[-1]:
        return 0.0  # a body without inertia along an axis along which the other one has some is no multiple of it
    root = axes[:, nonzero] / np.sqrt(squares[nonzero])
    return 1.0 / float(np.linalg.eigvalsh(root.T @ of @ root)[-1])


class StiffElement(NamedTuple):
    """Stiff element of the simulation: the oscillator x_ddot = -stiffness x - damping x_dot (1/s^2, 1/s), and the
    field, with value and unit, that makes it stiff."""

    field: str
    value: float
    unit: str
    stiffness: float
    damping: float


def stiff_elements(
    nature: ContactKind,
    contacts: Sequence[Contact],
    environment: EnvironmentMatrices,
    truth: Truth,
    mobility: Mobility,
    K_t: float = 0.0,
    joints: int = 0,
    paths: Sequence[str] = ("", "second.", "third."),
) -> Iterator[StiffElement]:
    """Stiff elements of the arm's springs and dampers, one for each cause. Each of k surfaces counts k times, which
    bounds their joint effect; force and moments of a flat face, with K_t N m/rad, each count twice. An arm turns the
    face by at most the number of its joints times the mobility of a joint. Coupled surfaces count with the largest
    eigenvalues of their matrices, whichever of them are touched. paths: where the contacts stand in the scenario."""
    k = 2 if K_t else len(contacts)
    if K_t and nature.springs:
        turning, B_t = k * joints * mobility.joints, contacts[0].B_e * K_t / max(contacts[0].K_e, 1e-3)
        yield StiffElement("face.K_t", K_t, "N·m/rad", turning * K_t, turning * B_t)
    for path, c in zip(paths, contacts, strict=False):
        Y = mobility.normal
        if nature.springs and not environment.coupled:
            Y = k * Y / (1.0 + c.M_e * Y) if nature.massive else k * Y
            yield StiffElement(f"{path}contact.B_e", c.B_e, "N·s/m", 0.0, Y * c.B_e)
            yield StiffElement(f"{path}contact.K_e", c.K_e, "N/m", Y * c.K_e, Y * c.B_e)
        if nature.touches:
            viscous = c.friction_viscous
            across = k * mobility.tangential
            yield StiffElement(f"{path}contact.friction_viscous", viscous, "N·s/m", 0.0, across * viscous)
    if environment.coupled:
        yield from _coupled(environment, k, mobility.normal)
    yield StiffElement("truth.viscous", truth.viscous, "N·m·s/rad", 0.0, mobility.joints * truth.viscous)


def _coupled(environment: EnvironmentMatrices, k: int, Y: float) -> Iterator[StiffElement]:
    """Stiff elements of k coupled surfaces on an arm with the mobility Y (1/kg), by the set that is touched."""
    for touched in chain.from_iterable(combinations(range(k), number) for number in range(1, k + 1)):
        M_e, B_e, K_e = (np.linalg.eigvalsh(matrix) for matrix in environment.acting(touched))
        yielding = k * Y / (1.0 + M_e[0].clip(min=0.0) * Y)
        stiffness, damping = float(yielding * K_e[-1]), float(yielding * B_e[-1])
        yield StiffElement("coupling.B_e", float(B_e[-1]), "N·s/m", 0.0, damping)
        yield StiffElement("coupling.K_e", float(K_e[-1]), "N/m", stiffness, damping)


def spectral_radius(integrator: IntegratorName, stiffness: float, damping: float, h: float) -> float:
    """Spectral radius of one step of h s: the largest factor by which it multiplies a deviation in the long run."""

    def acceleration(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -stiffness * x - damping * v

    x, v = np.eye(2)  # two columns at once: the deviations (1, 0) and (0, 1)
    step = np.array(INTEGRATORS[integrator].step(acceleration, x, v, h))
    return float(np.abs(np.linalg.eigvals(step)).max())


def resolved(integrator: IntegratorName, element: StiffElement, h: float) -> bool:
    """Whether deviations do not grow under steps of h s."""
    return spectral_radius(integrator, element.stiffness, element.damping, h) <= 1.0 + ROUNDING


def substeps_needed(integrator: IntegratorName, element: StiffElement, period: float, most: int) -> int | None:
    """Smallest number of steps per period (s) that resolves the element, None where even `most` do not."""
    return next((n for n in range(1, most + 1) if resolved(integrator, element, period / n)), None)
