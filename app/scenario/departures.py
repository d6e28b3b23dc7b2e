"""Departures of a true arm from the believed one, drawn within what a scenario declares."""

from __future__ import annotations

from typing import NamedTuple

import msgspec
import numpy as np

from app.scenario.declared_bounds import entries
from app.scenario.schema import STATED_IN, Declared, TruthSection

Random = np.random.Generator
NEARLY_ALL = 0.95  # of an inertia may be missing; a link without inertia is no body


class Departure(NamedTuple):
    """Departure of a true arm from the believed one, as shares of the declared bounds.
    links, rotors: (n,) within [-1, 1], the others within [0, 1].
    centres: (n, 3), shifts of the centres of mass within the unit ball.
    shapes: (n, 6), of `Truth.link_shape`, with eigenvalues within [-1, 1].
    towards: (3,), unit vector to the payload.
    frequency: of the disturbance, Hz."""

    links: np.ndarray
    rotors: np.ndarray
    centres: np.ndarray
    shapes: np.ndarray
    payload: float
    offset: float
    towards: np.ndarray
    coulomb: float
    viscous: float
    disturbance: float
    frequency: float

    @classmethod
    def inside(cls, random: Random, n: int) -> Departure:
        """Departure anywhere in the declared set, in half the draws of each quantity at its edge."""
        links, rotors = np.clip(random.uniform(-2.0, 2.0, (2, n)), -1.0, 1.0)
        payload, offset, coulomb, viscous, disturbance = np.minimum(random.uniform(0.0, 2.0, 5), 1.0)
        towards, frequency = _unit(random), random.uniform(0.2, 5.0)
        shifts = np.minimum(random.uniform(0.0, 2.0, (n, 1)), 1.0) * np.array([_unit(random) for _ in range(n)])
        shapes = _shapes(np.clip(random.uniform(-2.0, 2.0, (n, 3)), -1.0, 1.0), random)
        return cls(links, rotors, shifts, shapes, payload, offset, towards, coulomb, viscous, disturbance, frequency)

    @classmethod
    def edge(cls, random: Random, n: int) -> Departure:
        """Departure at a corner of the declared set."""
        links, rotors = random.choice([-1.0, 1.0], (2, n))
        towards, frequency = _unit(random), random.uniform(0.2, 5.0)
        shifts, shapes = (
            np.array([_unit(random) for _ in range(n)]),
            _shapes(random.choice([-1.0, 1.0], (n, 3)), random),
        )
        return cls(links, rotors, shifts, shapes, 1.0, 1.0, towards, 1.0, 1.0, 1.0, frequency)

    def truth(self, declared: Declared, scale: float = 1.0, of: TruthSection | None = None) -> TruthSection:
        """True arm of this departure, or one `scale` times as far away; of bounds that are stated in place of others it
        knows nothing, see `undrawn`. of: gives the fields that are not drawn."""
        d = declared
        return msgspec.structs.replace(
            of or TruthSection(),
            link_scaling=tuple((1.0 + scale * d.link_scaling * self.links).tolist()),
            rotor_scaling=tuple((1.0 + scale * d.rotor_scaling * self.rotors).tolist()),
            link_centre=tuple(map(tuple, (scale * d.link_centre * self.centres).tolist())),
            link_shape=tuple(map(tuple, (min(scale * d.link_shape, NEARLY_ALL) * self.shapes).tolist())),
            payload_mass=float(scale * d.payload_mass * self.payload),
            payload_offset=tuple((scale * d.payload_offset * self.offset * self.towards).tolist()),
            coulomb=float(scale * d.coulomb * self.coulomb),
            viscous=float(scale * d.viscous * self.viscous),
            disturbance=float(scale * d.disturbance * self.disturbance),
            disturbance_frequency=self.frequency,
        )


DRAWN = (
    "link_scaling", "rotor_scaling", "link_centre", "link_shape", "payload_mass", "payload_offset", "coulomb",
    "viscous", "disturbance", "disturbance_frequency",
)  # fmt: skip
# bounds of which each alone makes the arms that are drawn differ
MOVING = (
    "link_scaling", "rotor_scaling", "link_centre", "link_shape", "payload_mass", "coulomb", "viscous", "disturbance",
)  # fmt: skip


def undrawn(declared: Declared) -> str:
    """Reason for which no true arms can be drawn from the declared set, in words; "" where they can."""
    if stated := next((name for name in STATED_IN if getattr(declared, name) is not None), None):
        return f"declared.{stated} is stated, and only its run shows whether an arm is within it"
    return "" if any(getattr(declared, name) for name in MOVING) else "nothing is declared to be uncertain"


def _shapes(eigenvalues: np.ndarray, random: Random) -> np.ndarray:
    """Entries (n, 6) of symmetric matrices with these eigenvalues (n, 3), along axes drawn at random."""
    axes = np.linalg.qr(random.standard_normal((len(eigenvalues), 3, 3)))[0]
    return entries(axes * eigenvalues[:, None, :] @ axes.swapaxes(1, 2))


def _unit(random: Random) -> np.ndarray:
    v = random.standard_normal(3)
    return v / np.linalg.norm(v)
