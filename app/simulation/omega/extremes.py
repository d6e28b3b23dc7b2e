"""Largest values of functions over Omega: samples first, then scipy's SLSQP from the best of them.

Omega is a union of balls, cut where J_q comes too near to being singular, with the times of a surface that moves. The
values found are reached within Omega, so the true extreme is no smaller; no theorem says by how much it may be larger:
`app.simulation.omega.domain.MARGIN` covers that, and `tests/simulation/test_domain.py` makes other and longer searches.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

SOME = 24  # of the centres, about
MOST_SEARCHES = 12  # searches, each from a sample of its own
APART = 0.7  # radii between two samples to search from, at least
NEAR_CUT = 3.0  # times the limit on sigma_min, below which a search begins at the sample that is nearest to that limit
ITERATIONS = 25  # of one search
ENOUGH = 3e-4  # relative gain below which a search ends
GAIN = 1e-2  # relative gain over the best by which a search counts as worth while
STEP = 1e-5  # of finite differences, in radii and in spans of time
HALVINGS = 12  # on the way back into Omega


class Places(NamedTuple):
    """Postures q (N, n) rad at times t (N,) s."""

    q: np.ndarray
    t: np.ndarray


class ObjectiveValues(NamedTuple):
    """Values of an objective function at N places: several at once, since a call costs more than what it computes.
    value: (N,), to be maximized, > 0; 0 where nothing can be computed.
    room: (N,), margin to the cut of Omega, >= 0 within Omega."""

    value: np.ndarray
    room: np.ndarray

    @classmethod
    def uncut(cls, value: np.ndarray) -> ObjectiveValues:
        """Values (N,) of a function that cuts nothing off; places without a finite one are outside."""
        finite = np.isfinite(value)
        return cls(np.where(finite, value, 0.0), np.where(finite, np.inf, -1.0))


Objective = Callable[[Places], ObjectiveValues]
Objectives = Callable[[Places], tuple[ObjectiveValues, ...]]


class Nearest(NamedTuple):
    """Nearest centre of Omega.
    number: of the centre, counted from 0.
    distance: rad."""

    number: int
    distance: float


@dataclass(frozen=True)
class Omega:
    """Postures within `radius` (rad) of one of `centres` (N, n), at times from 0 to `span` s."""

    centres: np.ndarray
    radius: float
    span: float = 0.0

    def centre_near(self, q: np.ndarray) -> Nearest:
        """Centre nearest to q (n,) rad."""
        squares = np.square(self.centres - q).sum(axis=1)
        nearest = int(squares.argmin())
        return Nearest(nearest, float(np.sqrt(squares[nearest])))

    def way(self, q: np.ndarray, q_d: np.ndarray) -> float:
        """Length (rad) of a way from q to q_d (n,) rad that stays in Omega as long as these do: the straight one in the
        ball around the centre near q_d; from farther away that may lead out of Omega, and centre by centre is used."""
        there = self.centre_near(q_d)
        if np.linalg.norm(q - self.centres[there.number]) <= self.radius:
            return float(np.linalg.norm(q - q_d))
        here = self.centre_near(q)
        first, last = sorted((here.number, there.number))
        steps = np.diff(self.centres[first : last + 1], axis=0)
        return here.distance + float(np.linalg.norm(steps, axis=1).sum()) + there.distance

    def depth(self, q: np.ndarray) -> np.ndarray:
        """Depth (N,) of q (N, n) rad in Omega: 1 at a centre, 0 on the boundary, negative outside."""
        squares = np.square(q[:, None] - self.centres).sum(axis=2).min(axis=1)
        return 1.0 - np.square(np.sqrt(squares) / self.radius)

    def nearest(self, q: np.ndarray, t: float) -> Places:
        """The place in Omega nearest to q (n,) rad, t (s)."""
        number, away = self.centre_near(q)
        centre = self.centres[number]
        if away > self.radius:
            q = centre + (q - centre) * (self.radius * (1.0 - 1e-12) / away)  # a little inside, for rounding
        return Places(q[None], np.clip([t], 0.0, self.span))

    def places(self, count: int) -> Places:
        """Places in Omega, always the same: some of the centres, and `count` drawn around them."""
        random, n = np.random.default_rng(1), self.centres.shape[1]
        directions = random.standard_normal((count, n))
        directions *= self.radius / np.linalg.norm(directions, axis=1, keepdims=True)
        spread = np.linspace(0, len(self.centres) - 1, count).astype(int)
        around = self.centres[spread] + directions * random.uniform(size=(count, 1)) ** (1 / n)
        postures = np.concatenate([self.centres[:: max(8, len(self.centres) // SOME)], around])
        return Places(postures, self.span * random.uniform(size=len(postures)))


class _Sample(NamedTuple):
    """Sample: a posture q (n,) rad at a time t (s), and the objective's value there."""

    q: np.ndarray
    t: float
    value: float
    room: float


class Effort(NamedTuple):
    """Effort of a search.
    draws: number of places drawn from Omega.
    searches: the search ends when that many climbs in a row, the best one first, have ended no higher."""

    draws: int
    searches: int


def largest(omega: Omega, objectives: Objectives, effort: Effort) -> tuple[float, ...]:
    """Largest value within Omega of each value of the objectives, 0 where no sample lies within Omega."""
    places, found = omega.places(effort.draws), []
    for k, values in enumerate(objectives(places)):
        samples = [_Sample(*each) for each in zip(places.q, *np.array([places.t, *values]).tolist(), strict=True)]
        found.append(_climbed(omega, lambda some, k=k: objectives(some)[k], samples, effort.searches))
    return tuple(found)


def _climbed(omega: Omega, objective: Objective, samples: list[_Sample], patience: int) -> float:
    """Largest value found by climbs from one sample after the other. patience: see `Effort.searches`."""
    best, idle = 0.0, 0
    for start in _starts(omega, [s for s in samples if s.room >= 0.0 and s.value > 0.0]):
        found = _Climb(omega, objective, start).best
        idle = 1 if found > best * (1.0 + GAIN) else idle + 1
        best = max(best, found)
        if idle >= patience:
            break
    return best


def _starts(omega: Omega, samples: list[_Sample]) -> Iterator[_Sample]:
    """Samples to search from: the best ones, some way from each other, and one near the cut of Omega."""
    edge = min(samples, key=lambda s: s.room, default=None)
    if edge is not None and edge.room < NEAR_CUT - 1.0:
        yield edge
    begun: list[_Sample] = []
    for sample in sorted(samples, key=lambda s: -s.value):
        if all(np.linalg.norm(sample.q - other.q) > APART * omega.radius for other in begun):
            begun.append(sample)
            yield sample
        if len(begun) == MOST_SEARCHES:
            break


class _Climb:
    """Climb: one search by SLSQP; `best` is the largest value that it has found within Omega.

    Its variable x is the displacement from the start, in radii, followed by the time, in spans, where the surface
    moves.
    """

    def __init__(self, omega: Omega, objective: Objective, start: _Sample) -> None:
        self._omega, self._objective, self._start = omega, objective, start
        self._timed = omega.span > 0.0
        self.best = start.value
        self._at, self._row, self._slopes = np.empty(0), np.empty(0), np.empty(0)
        self._run()

    def _run(self) -> None:
        from scipy.optimize import minimize  # takes 0.1 s: where the constants are known, a run does not wait for it

        n = len(self._start.q)
        x_0 = np.append(np.zeros(n), [self._start.t / self._omega.span] if self._timed else [])
        steep = float(np.linalg.norm(self._seen(x_0)[1][0])) or 1.0  # scaled by the slope, the first step is one radius
        end = minimize(
            lambda x: self._seen(x)[0][0] / steep,
            x_0,
            method="SLSQP",
            jac=lambda x: self._seen(x)[1][0] / steep,
            bounds=[(None, None)] * n + [(0.0, 1.0)] * self._timed,
            constraints={"type": "ineq", "fun": lambda x: self._seen(x)[0][1:], "jac": lambda x: self._seen(x)[1][1:]},
            options={"maxiter": ITERATIONS, "ftol": ENOUGH / steep},
        ).x
        # it may end a little outside: only places within Omega count, the farthest one on the way there
        for fraction in 1.0 - np.append(0.0, 0.5 ** np.arange(HALVINGS, 0, -1)):
            (q,), (t,) = self._places((x_0 + fraction * (end - x_0))[None])
            value, room = self._objective(self._omega.nearest(q, t))
            if room[0] >= 0.0:
                self.best = max(self.best, float(value[0]))
                break

    def _places(self, x: np.ndarray) -> Places:
        n = len(self._start.q)
        times = self._omega.span * x[:, n] if self._timed else np.zeros(len(x))
        return Places(self._start.q + self._omega.radius * x[:, :n], times)

    def _rows_at(self, x: np.ndarray) -> np.ndarray:
        """Rows (N, 3) at N variables: -log(value), to be minimized, then room and depth, not to be negative."""
        places = self._places(x)
        value, room = self._objective(places)
        known = np.where(value > 0.0, value, 1.0)
        return np.array([-np.log(known), np.minimum(room, 1e3), self._omega.depth(places.q)]).T

    def _seen(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The row (3,) at x and its slopes (3, len(x)); copies, since SLSQP writes over what it is given."""
        if not np.array_equal(x, self._at):
            self._at = x.copy()
            self._row, *beside = self._rows_at(x + STEP * np.eye(len(x) + 1, len(x), -1))  # first x itself
            self._slopes = (np.array(beside) - self._row).T / STEP
        return self._row.copy(), self._slopes.copy()
