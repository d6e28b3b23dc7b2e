"""Stability of the target model (8) against every surface that the tool may touch. K_f need not be a multiple of the
identity.

On a surface with unit normal n, F_r = n (K_e + B_e s + M_e s^2) n^T r + f s (I - n n^T) r with viscous friction f, and
with N = M_m^-1 K_f, Q = n n^T, (8) becomes

    (I + M_e N Q) e_ddot + [M_m^-1 B_m + N (B_e Q + f (I - Q))] e_dot + [M_m^-1 K_m + K_e N Q] e = ...

Sufficient: K_f^-1 M_m, K_f^-1 B_m and K_f^-1 K_m s.p.d. Then (8) divided by K_f is a passive mass-damper-spring, as the
surface is. Otherwise the rightmost pole is searched for over all surfaces, and all models of a blend, from many
samples and by descent from the best of them. Where K_e alone makes a pole 0, det(K_m + K_e K_f Q) = 0, the normal is
known: 1 + K_e n^T K_m^-1 K_f n is least along an eigenvector. The search also begins there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from controllers.target_model import InvalidGain, TargetModel

SAMPLES, DESCENTS, STEPS = 3000, 4, 400
MODELS = 41  # of a blend, on which the search for an unstable one begins
SYMMETRIC = 1e-9  # of the largest entry
REAL = 1e-6  # share of its magnitude up to which the imaginary part of an eigenvalue is rounding


class SurfaceRange(NamedTuple):
    """Range of surfaces that a model may touch.
    K_e, B_e, M_e, friction: N/m, N s/m, kg, and viscous along the surface N s/m, each anywhere from 0 to this.
    first: number of the first coordinate in which forces lie.
    directions: number of coordinates, from `first` on, in which forces lie.
    normal: the surface's normal is any one of these directions; otherwise they all lie along the surface."""

    K_e: float
    B_e: float
    M_e: float
    friction: float
    first: int
    directions: int
    normal: bool


@dataclass(frozen=True)
class Unstable:
    """Unstable model on a surface, at the share alpha of a blend's way.
    normal: (directions,), the surface's unit normal, 0 if it is none of the directions.
    K_e, B_e, M_e, friction: N/m, N s/m, kg, and viscous N s/m.
    pole: the model's rightmost one, 1/s."""

    alpha: float
    normal: np.ndarray
    K_e: float
    B_e: float
    M_e: float
    friction: float
    pole: complex

    @property
    def sentence(self) -> str:
        """Sentence on the pole and the surface."""
        rest = (
            ("K_e", self.K_e, "N/m"),
            ("B_e", self.B_e, "N·s/m"),
            ("M_e", self.M_e, "kg"),
            ("viscous friction", self.friction, "N·s/m"),
        )
        surface = ", ".join(f"{name} = {v:.4g} {unit}" for name, v, unit in rest if v)
        if self.normal.any():
            surface += f" with the normal ({', '.join(f'{component:.3f}' for component in self.normal)})"
        imaginary = f" ± {self.pole.imag:.3g}j" if self.pole.imag else ""
        return f"a pole at {self.pole.real:.4g}{imaginary} 1/s on a surface of {surface}"


def require_stable_on(model: TargetModel, surfaces: SurfaceRange) -> None:
    """Raise InvalidGain, with the worst surface, unless the model, which is stable by itself, is stable on all
    surfaces."""
    worst = unstable_surface(model, model, surfaces)
    if worst is not None:
        raise InvalidGain(
            f"target_model: the continuous model (8) is unstable by itself, with {worst.sentence}, whatever the "
            "control period; allowed: K_f^-1 M_m, K_f^-1 B_m and K_f^-1 K_m symmetric positive definite, as with K_f a "
            "multiple of the identity (27), or a smaller contact.K_e"
        )


def passive(model: TargetModel) -> bool:
    """Whether K_f^-1 M_m, K_f^-1 B_m and K_f^-1 K_m are s.p.d., so that no passive surface can destabilise (8)."""
    try:
        divided = np.linalg.solve(model.K_f, np.stack([model.M_m, model.B_m, model.K_m]))
    except np.linalg.LinAlgError:
        return False
    return all(
        np.abs(matrix - matrix.T).max() <= SYMMETRIC * np.abs(matrix).max() and np.linalg.eigvalsh(matrix)[0] > 0.0
        for matrix in divided
    )


def passive_throughout(start: TargetModel, end: TargetModel, first: int = 0) -> bool:
    """Whether every model of a blend is `passive` in the coordinates from `first` on, which are not coupled with the
    others.

    N = M_m^-1 K_f, beta = M_m^-1 B_m and kappa = M_m^-1 K_m are linear in alpha, see `controllers.blend`. N stays
    s.p.d. between s.p.d. ends. K_f^-1 B_m = N^-1 beta is symmetric where beta N is; the rest, alpha (1 - alpha) C
    between symmetric ends, is 0 everywhere if it is 0 halfway. It stays positive definite while beta is regular, which
    is so unless beta_0^-1 beta_1 has a negative eigenvalue. The same holds for kappa.
    """
    way = _Way.between(start, end, first)
    if not all(passive(way.model(alpha)) for alpha in (0.0, 0.5, 1.0)):
        return False
    (_, *begin, _), (_, *last, _) = way.begin, way.begin + way.change
    found = np.linalg.eigvals(np.linalg.solve(np.stack(begin), np.stack(last)))
    return not ((found.real < 0.0) & (np.abs(found.imag) <= REAL * np.abs(found))).any()


def unstable_surface(start: TargetModel, end: TargetModel, surfaces: SurfaceRange) -> Unstable | None:
    """Surface with the rightmost pole that was found, where that is unstable, for the models of a blend, in which
    M_m^-1, M_m^-1 B_m, M_m^-1 K_m and M_m^-1 K_f go from those of `start` to those of `end`."""
    if surfaces.first == start.n or surfaces.directions == 0:
        return None  # a force is controlled in every coordinate that a surface can push
    if passive_throughout(start, end, surfaces.first):
        return None
    from scipy.optimize import minimize  # takes 0.1 s: where no search is needed, a run does not wait for it

    way = _Way.between(start, end, surfaces.first)
    search = _Search(way, surfaces)
    samples = search.samples(np.linspace(0.0, 1.0, MODELS if way.blends else 1))
    found = _rightmost(search.loops(samples))
    starts = samples[np.argsort(np.real(found))[-DESCENTS:]]
    ends = [
        minimize(lambda x: -search.pole(x).real, x, method="Nelder-Mead", options={"maxfev": STEPS}).x
        for x in (*starts, *search.static())
    ]
    worst = max((*starts, *ends), key=lambda x: search.pole(x).real)
    return search.named(worst) if search.pole(worst).real >= 0.0 else None


class _Way(NamedTuple):
    """Way from M_m^-1, M_m^-1 B_m, M_m^-1 K_m, M_m^-1 K_f of one model, (4, n, n), to those of another."""

    begin: np.ndarray
    change: np.ndarray

    @classmethod
    def between(cls, start: TargetModel, end: TargetModel, first: int) -> _Way:
        """Way of the coordinates from `first` on, which are not coupled with the others."""
        begin, last = (
            np.linalg.solve(model.M_m, np.stack([np.eye(model.n), model.B_m, model.K_m, model.K_f]))[:, first:, first:]
            for model in (start, end)
        )
        return cls(begin, last - begin)

    @property
    def blends(self) -> bool:
        return bool(self.change.any())

    def model(self, alpha: float) -> TargetModel:
        M_inv, beta, kappa, N = self.begin + alpha * self.change
        M_m = np.linalg.inv(M_inv)
        return TargetModel(M_m, M_m @ beta, M_m @ kappa, M_m @ N)


@dataclass(frozen=True)
class _Search:
    """Search over points x = (normal, four shares of the surface's range, alpha): any numbers, shares and alpha cut to
    [0, 1]."""

    way: _Way
    surfaces: SurfaceRange

    def samples(self, alphas: np.ndarray) -> np.ndarray:
        """Sample points (SAMPLES, p + 5), always the same; in half of them each property of the surface is 0 or the
        largest."""
        random, p = np.random.default_rng(0), self.surfaces.directions
        fractions = random.random((SAMPLES, 4)) ** 3
        fractions[::2] = random.integers(0, 2, (len(fractions[::2]), 4))
        return np.hstack([random.standard_normal((SAMPLES, p)), fractions, random.choice(alphas, (SAMPLES, 1))])

    def static(self) -> list[np.ndarray]:
        """Points at both ends of the way where K_e comes nearest to a pole at 0."""
        p, points = self.surfaces.directions, []
        for alpha in (0.0, 1.0) if self.way.blends else (0.0,):
            _, _, kappa, N = self.way.begin + alpha * self.way.change
            yielding = np.linalg.solve(kappa, N)[:p, :p]
            normal = np.linalg.eigh(yielding + yielding.T)[1][:, 0]
            points.append(np.concatenate([normal, [1.0, 0.0, 0.0, 0.0], [alpha]]))
        return points

    def _read(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Unit normals (N, p), properties (4, N) and alphas (N,) of points (N, p + 5)."""
        p = self.surfaces.directions
        normals = x[:, :p] / np.linalg.norm(x[:, :p], axis=1, keepdims=True)
        if not self.surfaces.normal:
            normals = np.zeros_like(normals)
        properties = np.clip(x[:, p:-1], 0.0, 1.0) * np.array(self.surfaces[:4])
        return normals, properties.T, np.clip(x[:, -1], 0.0, 1.0)

    def loops(self, x: np.ndarray) -> np.ndarray:
        """Companion matrices (N, 2n, 2n), 1/s, of points (N, p + 5)."""
        normals, properties, alphas = self._read(x)
        K_e, B_e, M_e, friction = (each[:, None, None] for each in properties)
        _, beta, kappa, N = np.moveaxis(self.way.begin + alphas[:, None, None, None] * self.way.change, 1, 0)
        (count, p), n = normals.shape, N.shape[-1]
        across, along = np.zeros((2, count, n, n))
        across[:, :p, :p] = normals[:, :, None] * normals[:, None, :]
        along[:, :p, :p] = np.eye(p) - across[:, :p, :p]
        rates = np.concatenate([kappa + K_e * N @ across, beta + N @ (B_e * across + friction * along)], axis=2)
        loops = np.zeros((count, 2 * n, 2 * n))
        loops[:, :n, n:] = np.eye(n)
        loops[:, n:] = -np.linalg.solve(np.eye(n) + M_e * N @ across, rates)
        return loops

    def pole(self, x: np.ndarray) -> complex:
        """Rightmost pole, 1/s, at a single point."""
        return complex(_rightmost(self.loops(x[None]))[0])

    def named(self, x: np.ndarray) -> Unstable:
        """Surface and model of a point."""
        (normal,), properties, (alpha,) = self._read(x[None])
        normal = normal * (np.sign(normal[np.argmax(np.abs(normal))]) or 1.0) + 0.0
        K_e, B_e, M_e, friction = (float(each[0]) for each in properties)
        return Unstable(float(alpha), normal, K_e, B_e, M_e, friction, self.pole(x))


def _rightmost(loops: np.ndarray) -> np.ndarray:
    """Rightmost eigenvalue of each matrix, the upper one of a pair."""
    values = np.linalg.eigvals(loops)
    found = np.take_along_axis(values, values.real.argmax(axis=1)[:, None], axis=1)[:, 0]
    return found.real + 1j * np.abs(found.imag)
