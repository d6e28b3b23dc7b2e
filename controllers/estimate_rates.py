"""Rates of change of the estimates at one posture, bounded over all directions, and their largest values over Omega."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from controllers.nominal_model import Deviation


class Lipschitz(NamedTuple):
    """Lipschitz constants over Omega.
    k_C: as in `bounds.Uncertainty`.
    k_M, k_G: largest change of M_hat and G_hat per rad.
    k_Cq: largest change of C_hat / ||q_dot|| per rad."""

    k_C: float
    k_M: float
    k_Cq: float
    k_G: float

    def deviation(self, away: float, q_dot: np.ndarray, q_d_dot: np.ndarray) -> Deviation:
        """Bounds of the differences between estimates taken at (q_d, q_d_dot) and those at (q, q_dot), Remark 3.
        away: rad, length of a way from q to q_d within Omega, over which the constants hold."""
        slower = float(np.linalg.norm(q_dot - q_d_dot))
        speed = float(np.linalg.norm(q_d_dot))
        delta_C = self.k_C * slower + self.k_Cq * away * speed
        return Deviation(self.k_M * away, delta_C, self.k_G * away, self.k_C)


def _largest(T: np.ndarray) -> np.ndarray:
    """Upper bound of ||T(., u, ...)|| for unit vectors u, ... in all axes but one, of each T (N, n, ..., k): the least
    of the flattenings' norms, (N,)."""
    flat = (T.swapaxes(1, axis).reshape(len(T), T.shape[axis], -1) for axis in range(1, T.ndim))
    squares = np.array([np.linalg.eigvalsh(A @ A.swapaxes(1, 2))[:, -1] for A in flat])
    return np.sqrt(squares.clip(min=0.0)).min(axis=0)


class LinkRates(NamedTuple):
    """Bounds over Omega of what errors of the links do to C, (6), each of a sum over the links of ||Delta C_i|| over
    ||q_dot||.
    k_centre: per m of the centres of mass, to first order, kg m/rad.
    k_swing: per m^2 of them, to second order, kg/rad.
    k_shape: per unit of the inertias about them, kg m^2/rad."""

    k_centre: float
    k_swing: float
    k_shape: float


NO_RATES = LinkRates(0.0, 0.0, 0.0)
# symmetric matrices (6, 3, 3), orthonormal in Frobenius' norm
SYMMETRIC_BASIS = np.zeros((6, 3, 3))
for _row, (_a, _b) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
    SYMMETRIC_BASIS[_row, _a, _b] = SYMMETRIC_BASIS[_row, _b, _a] = 1.0 if _a == _b else np.sqrt(0.5)


class LocalRates:
    """Rates of change of the estimates at postures q (N, n) rad, bounded from above over all directions: the constants
    of `Lipschitz` at these postures, each (N,), by the same names."""

    def __init__(self, model: pin.Model) -> None:
        self._whole = (model, model.createData())
        self._links = []
        for link in range(1, model.nv + 1):
            alone = model.copy()
            for other in range(1, model.nv + 1):
                if other != link:
                    alone.inertias[other] = pin.Inertia.Zero()
            self._links.append((alone, alone.createData()))
        self._units = np.eye(model.nv)

    def _coriolis(self, q: np.ndarray) -> np.ndarray:
        """C_hat for each joint at 1 rad/s, (N, n, n, n); C_hat is linear in q_dot."""
        return np.array([[pin.computeCoriolisMatrix(*self._whole, each, one) for one in self._units] for each in q])

    def k_C(self, q: np.ndarray) -> np.ndarray:
        """Bound of C_hat over ||q_dot||, link by link, kg m^2/rad."""
        n = q.shape[1]
        C = np.zeros((len(q), n, n, n, n))
        for own, each in zip(C, q, strict=True):
            for link, arm in enumerate(self._links):
                for joint in range(link + 1):  # the others do not move the link
                    own[link, joint] = pin.computeCoriolisMatrix(*arm, each, self._units[joint])
        return _largest(C.reshape(-1, n, n, n)).reshape(-1, n).sum(axis=1)

    def k_M(self, q: np.ndarray) -> np.ndarray:
        """Bound of the change of M_hat, kg m^2/rad; M_dot = C + C^T."""
        C = self._coriolis(q)
        return _largest(C + C.swapaxes(2, 3))

    def links(self, q: np.ndarray) -> np.ndarray:
        """Bounds of what errors of the links do to C over ||q_dot||, (N, 3): the numbers of `LinkRates`.

        The Christoffel matrix of a body is m J_c^T J_c_dot + J_w^T (I J_w_dot - [w] (tr(I)/2 - I) J_w), docs/theory.md.
        """
        first = np.array([_largest(self.by_centre(each)).sum() for each in q])
        turned = np.array([_largest(self.by_inertia(each)) for each in q])
        links = list(self._whole[0].inertias)[1:]
        masses = np.array([link.mass for link in links])
        sizes = np.array([np.linalg.norm(link.inertia) for link in links])
        return np.array([first, np.sqrt(2.0) * turned @ masses, turned @ sizes]).T

    def by_centre(self, q: np.ndarray) -> np.ndarray:
        """Change of C per m of each link's centre of mass along the world's axes, to first order, (links, n, n, n, 3):
        for each joint at 1 rad/s, row, column."""
        J_c, J_w, dJ_c, dJ_w = self._motion(q)
        units, m = np.eye(3), np.array([link.mass for link in list(self._whole[0].inertias)[1:]])
        D = np.cross(J_w[..., None, :], units)  # (links, column, 3 of the shift, 3)
        turned = np.cross(J_w[:, None, :, None, :], D[:, :, None])  # (links, joint, column, shift, 3)
        dD = np.cross(dJ_w[..., None, :], units) + turned
        C = np.einsum("ila,ikjda->ikljd", J_c, dD) + np.einsum("ilda,ikja->ikljd", D, dJ_c)
        return m[:, None, None, None, None] * C

    def by_inertia(self, q: np.ndarray) -> np.ndarray:
        """Change of C per unit of each link's inertia about its centre of mass, along six orthonormal symmetric
        matrices in the world, (links, n, n, n, 6): as `by_centre`."""
        _, J_w, _, dJ_w = self._motion(q)
        half = 0.5 * np.trace(SYMMETRIC_BASIS, axis1=1, axis2=2)[:, None, None] * np.eye(3) - SYMMETRIC_BASIS
        grown = np.einsum("bac,ikjc->ikjba", SYMMETRIC_BASIS, dJ_w)
        turned = np.cross(J_w[:, :, None, None, :], np.einsum("bac,ijc->ijba", half, J_w)[:, None])
        return np.einsum("ila,ikjba->ikljb", J_w, grown - turned)

    def _motion(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Columns J_c, J_w (links, n, 3) of each link's centre of mass, and their rates dJ_c, dJ_w (links, n, n, 3) for
        each joint at 1 rad/s: a joint turns the columns after it, and the one of its own moves as they do."""
        model, data = self._whole
        J, n = pin.computeJointJacobians(model, data, q).T.copy(), model.nv
        centres = np.array([data.oMi[i].act(model.inertias[i].lever) for i in range(1, n + 1)])
        before = np.tril(np.ones((n, n)))[..., None]  # link i is moved by joint j <= i
        J_w = before * J[None, :, 3:]
        J_c = before * (J[None, :, :3] + np.cross(J[None, :, 3:], centres[:, None, :]))
        earlier = np.tril(np.ones((n, n)), -1)[..., None]  # [j, k]: joint k before joint j
        by_k = np.cross(J_w[:, None, :, :], J_c[:, :, None, :])  # [j, k]: of J_c_j, turned by joint k
        dJ_c = (earlier + np.eye(n)[..., None]) * by_k
        dJ_c = dJ_c + (earlier * by_k).swapaxes(1, 2)
        dJ_w = earlier * np.cross(J_w[:, None, :, :], J_w[:, :, None, :])
        return J_c, J_w, dJ_c.swapaxes(1, 2), dJ_w.swapaxes(1, 2)

    def k_Cq(self, q: np.ndarray) -> np.ndarray:
        """Bound of the change of C_hat / ||q_dot||, kg m^2/rad^2."""
        step, here = 1e-5, self._coriolis(q)
        beside = np.array([self._coriolis(each + step * self._units) for each in q])
        return _largest((beside - here[:, None]) / step)

    def k_G(self, q: np.ndarray) -> np.ndarray:
        """Bound of the change of G_hat, N m/rad."""
        return _largest(np.array([pin.computeGeneralizedGravityDerivatives(*self._whole, each).copy() for each in q]))
