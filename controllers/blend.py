"""Blend from one target model (8) to another: the convex blend between them, and a certificate that it stays stable.

The blend is linear in M_m^-1, M_m^-1 B_m, M_m^-1 K_m and M_m^-1 K_f, since only the last three act in (13) and in the
motion. M_m itself scales the residual of (8) and nothing else; as M_m^-1 is blended, too, a K_f that both models share
is kept.

The sliding variable s (10) does not depend on the model, only z_dot (9) does. So with F_1, F_2 and z kept, s is
continuous whatever the model does, (12) and (14) hold at every instant with the model in force then, and Theorem 1
makes the same promise for ||s|| as without a blend. A blend can only spoil (8) itself: its errors obey

    e_ddot + M_m^-1 B_m e_dot + M_m^-1 (K_m + K_f K_e) e = 0

on a surface of stiffness K_e, and between two stable models there may be unstable ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from controllers.dominance import hurwitz_on_hull
from controllers.segment import Rightmost, rightmost
from controllers.surface_stability import SurfaceRange, Unstable, unstable_surface
from controllers.target_model import TargetModel, companion

CERTIFIED = ("theorem 4", "eigenvalues", "nothing")  # `BlendCertificate.by`, the strongest first
PIECES = 500  # pieces of a blend, each with a constant model: alpha rises by at most 0.0038 from one to the next


@dataclass(frozen=True)
class ModelBlend:
    """Blend of the target model over time, in `PIECES` steps.
    start, end: the models before and after it.
    begins, over: s, when it begins, and how long it takes.
    certificate: of the models on the way."""

    start: TargetModel
    end: TargetModel
    begins: float
    over: float
    certificate: BlendCertificate

    def share(self, t: float) -> float:
        """Share alpha in force at time t (s), from 0 to 1 with zero speed and acceleration at both ends."""
        piece = np.floor(PIECES * (t - self.begins) / self.over + 1e-9)
        u = float(min(max((piece + 0.5) / PIECES, 0.0), 1.0))
        return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)

    def at(self, t: float) -> TargetModel:
        """The model in force at time t (s)."""
        return blended(self.start, self.end, self.share(t))


def blended(start: TargetModel, end: TargetModel, alpha: float) -> TargetModel:
    """The model at the share alpha of the way from one model to the other; exactly the ends at 0 and 1."""
    if alpha in (0.0, 1.0):
        return end if alpha else start
    inverses = [np.linalg.inv(model.M_m) for model in (start, end)]
    M_m = np.linalg.inv((1.0 - alpha) * inverses[0] + alpha * inverses[1])
    B_m, K_m, K_f = (
        M_m @ ((1.0 - alpha) * inverses[0] @ of_start + alpha * inverses[1] @ of_end)
        for of_start, of_end in ((start.B_m, end.B_m), (start.K_m, end.K_m), (start.K_f, end.K_f))
    )
    return TargetModel(M_m, B_m, K_m, K_f)


@dataclass(frozen=True)
class BlendCertificate:
    """Certificate of the blend between two models.

    by: "theorem 4": stable however fast the blend is; "eigenvalues": each model on the way is stable by itself;
    "nothing": the one at `rightmost.alpha` is not.
    rightmost: the worst pole on the way, 1/s.
    sliding: (n,) 1/s, for each axis that Theorem 4 certifies the lambda of its coordinates (e, e_dot + lambda e), nan
    for the others.
    surface: on which the model at `rightmost.alpha` is unstable though it is stable in free motion; None otherwise.
    """

    by: Literal["theorem 4", "eigenvalues", "nothing"]
    rightmost: Rightmost
    sliding: np.ndarray
    surface: Unstable | None = None

    @property
    def stable(self) -> bool:
        return self.by != "nothing"

    @property
    def sentence(self) -> str:
        """Sentence on the certificate, with the worst pole and its place on the way."""
        pole, alpha = self.rightmost.eigenvalue, self.rightmost.alpha
        if self.surface is not None:
            return f"refused: at α = {alpha:.3g} {self.surface.sentence}".replace("-", "−")
        imaginary = f" ± {pole.imag:.3g}j" if pole.imag > 1e-6 * abs(pole) else ""
        where = f"at α = {alpha:.3g} a pole at {pole.real:.3g}{imaginary} 1/s".replace("-", "−")
        return {
            "theorem 4": f"certified by Theorem 4, however fast the blend; the rightmost pole: {where}",
            "eigenvalues": f"certified by eigenvalues, each model on the way by itself; the rightmost pole: {where}",
            "nothing": f"refused: {where}",
        }[self.by]


def certify(
    start: TargetModel, end: TargetModel, K_e: np.ndarray, surfaces: SurfaceRange | None = None
) -> BlendCertificate:
    """Certificate whether every blend between two stable models stays stable, in an environment of stiffness K_e
    (n, n) N/m, and on all `surfaces` that the tool may touch otherwise.

    Coordinates with infinite K_e on its diagonal are held (42) and take no part. Coordinates that neither model couples
    are judged separately. One that is uncoupled and overdamped in both models can be certified by Theorem 4; for the
    others the rightmost pole decides.
    """
    from scipy.sparse.csgraph import connected_components  # takes 0.1 s: a run without a blend does not wait for it

    sliding = np.full(start.n, np.nan)
    moving = np.flatnonzero(np.isfinite(np.diag(K_e)))
    beta, kappa = zip(*(_normalised(model, K_e, moving) for model in (start, end)), strict=True)
    coupled = np.abs([*beta, *kappa]).sum(axis=0)
    _, groups = connected_components(coupled, directed=False)
    worst, uncertified = [], False
    for group in range(groups.max() + 1):
        members = np.flatnonzero(groups == group)
        axes = np.ix_(members, members)
        A_0, A_1 = (companion(b[axes], k[axes]) for b, k in zip(beta, kappa, strict=True))
        worst.append(rightmost(A_0, A_1))
        if (A_0 == A_1).all():
            continue  # the two models are equal here
        if len(members) == 1:
            of_axis = [(float(b[axes][0, 0]), float(k[axes][0, 0])) for b, k in zip(beta, kappa, strict=True)]
            sliding[moving[members[0]]] = shared_sliding(*of_axis)
        uncertified = uncertified or bool(np.isnan(sliding[moving[members]]).any())
    rightmost_of_all = max(worst, key=lambda found: found.at_most)
    if rightmost_of_all.at_most >= 0.0:
        return BlendCertificate("nothing", rightmost_of_all, sliding)
    if surfaces is not None and (surface := unstable_surface(start, end, surfaces)) is not None:
        touching = Rightmost(surface.alpha, surface.pole, surface.pole.real)
        return BlendCertificate("nothing", touching, sliding, surface)
    # Theorem 4 compares the models in one environment: a tool that touches and leaves a surface switches between two
    certain = not uncertified and surfaces is None
    return BlendCertificate("theorem 4" if certain else "eigenvalues", rightmost_of_all, sliding)


def _normalised(model: TargetModel, K_e: np.ndarray, moving: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrices M_m^-1 B_m and M_m^-1 (K_m + K_f K_e) of the coordinates that move."""
    axes = np.ix_(moving, moving)
    stiffness = model.K_m[axes] + model.K_f[axes] @ K_e[axes]
    return np.linalg.solve(model.M_m[axes], model.B_m[axes]), np.linalg.solve(model.M_m[axes], stiffness)


def axis_matrix(beta: float, kappa: float, sliding: float) -> np.ndarray:
    """Matrix of one axis e_ddot + beta e_dot + kappa e = 0 in the coordinates (e, e_dot + lambda e), lambda = sliding,
    1/s."""
    return np.array([[-sliding, 1.0], [sliding * (beta - sliding) - kappa, sliding - beta]])


def shared_sliding(first: tuple[float, float], second: tuple[float, float]) -> float:
    """The lambda (1/s) with which Theorem 4 certifies the blend of two axes (beta, kappa), nan if there is none.

    Off the diagonal its matrices are >= 0 exactly where lambda lies between the real poles (as magnitudes) of both.
    Their first rows are then alike, so that one of the two dominates the other rowwise.
    """
    ranges = []
    for beta, kappa in (first, second):
        apart = beta**2 / 4.0 - kappa
        if apart < 0.0 or beta <= 0.0 or kappa <= 0.0:
            return np.nan
        fast = beta / 2.0 + np.sqrt(apart)
        ranges.append((kappa / fast, fast))
    low, high = max(low for low, _ in ranges), min(high for _, high in ranges)
    sliding = float(np.sqrt(low * high))
    A = [axis_matrix(*axis, sliding) for axis in (first, second)]
    certified = low <= high and any(hurwitz_on_hull(pair, by) for pair in (A, A[::-1]) for by in ("rows", "columns"))
    return sliding if certified else np.nan
