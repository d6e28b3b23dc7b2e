"""Departures of a true arm from the believed one, drawn within what a scenario declares."""

from __future__ import annotations

from typing import NamedTuple

import msgspec
import numpy as np

from app.scenario.schema import Declared, TruthSection

Random = np.random.Generator


class Departure(NamedTuple):
    """Departure of a true arm from the believed one, as shares of the declared bounds.
    links, rotors: (n,) within [-1, 1], the others within [0, 1].
    towards: (3,), unit vector to the payload.
    frequency: of the disturbance, Hz."""

    links: np.ndarray
    rotors: np.ndarray
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
        return cls(links, rotors, payload, offset, towards, coulomb, viscous, disturbance, frequency)

    @classmethod
    def edge(cls, random: Random, n: int) -> Departure:
        """Departure at a corner of the declared set."""
        links, rotors = random.choice([-1.0, 1.0], (2, n))
        return cls(links, rotors, 1.0, 1.0, _unit(random), 1.0, 1.0, 1.0, random.uniform(0.2, 5.0))

    def truth(self, declared: Declared, scale: float = 1.0, of: TruthSection | None = None) -> TruthSection:
        """True arm of this departure, or one `scale` times as far away; what it does not name is as in `of`."""
        d = declared
        return msgspec.structs.replace(
            of or TruthSection(),
            link_scaling=tuple((1.0 + scale * d.link_scaling * self.links).tolist()),
            rotor_scaling=tuple((1.0 + scale * d.rotor_scaling * self.rotors).tolist()),
            payload_mass=float(scale * d.payload_mass * self.payload),
            payload_offset=tuple((scale * d.payload_offset * self.offset * self.towards).tolist()),
            coulomb=float(scale * d.coulomb * self.coulomb),
            viscous=float(scale * d.viscous * self.viscous),
            disturbance=float(scale * d.disturbance * self.disturbance),
            disturbance_frequency=self.frequency,
        )


DRAWN = (
    "link_scaling", "rotor_scaling", "payload_mass", "payload_offset", "coulomb", "viscous", "disturbance",
    "disturbance_frequency",
)  # fmt: skip


def _unit(random: Random) -> np.ndarray:
    v = random.standard_normal(3)
    return v / np.linalg.norm(v)
