"""Row of a control period: its recorded signals, field by field, with unit and meaning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple, get_type_hints

import numpy as np

from app.scenario.units import Units, kinds_of
from controllers.bounds import CAUSES
from parameters import UnitsOf


@dataclass(frozen=True)
class Signal:
    """A field of `Row`.
    unit, doc: of its numbers, for revolute joints and where r is in metres.
    of: on whose units its own depends, "" for the world's: joints, task coordinates r, or their Jacobian.
    width: number of its numbers, None for one per task coordinate or joint."""

    unit: str
    doc: str
    of: UnitsOf = ""
    width: int | None = None
    name: str = ""

    def unit_in(self, units: Units) -> str:
        """Unit of all of its numbers; both units where some are of revolute and some of prismatic joints."""
        return units.of_kind(self.of, self.unit)

    def units_in(self, units: Units, slides: Sequence[bool]) -> list[str]:
        """Unit of each of its numbers. slides: whether each joint is prismatic."""
        if self.width is None and (self.of == "joints" or units.task == "joint"):
            return [self.unit_in(Units(units.task, kinds_of((each,)))) for each in slides]
        return [self.unit_in(units)] * self.wide(len(slides))

    def wide(self, n: int) -> int:
        """Number of its numbers with n coordinates."""
        return n if self.width is None else self.width


Number = float
Vector = np.ndarray


class Row(NamedTuple):
    """Recorded signals of one control period. `control_period` fills it, except for the fields that are known only
    after the plant's response, which `complete_row` fills."""

    t: Annotated[Number, Signal("s", "simulated time")]
    q: Annotated[Vector, Signal("rad", "joint coordinates", "joints")]
    q_dot: Annotated[Vector, Signal("rad/s", "joint rates", "joints")]
    r: Annotated[Vector, Signal("m", "task coordinates of the tool, (3)", "r")]
    r_dot: Annotated[Vector, Signal("m/s", "their rates", "r")]
    r_d: Annotated[Vector, Signal("m", "desired task coordinates: what r is to follow", "r")]
    e_r: Annotated[Vector, Signal("m", "tracking error r − r_d, of which angles count ℓ times", "r")]
    e_r_dot: Annotated[Vector, Signal("m/s", "rate of the tracking error", "r")]
    tool: Annotated[Vector, Signal("m", "tool point in the world", width=3)]
    F: Annotated[
        Vector, Signal("N", "measured force of the tool on what touches it, surface and hand, world axes", width=3)
    ]
    moment: Annotated[Vector, Signal("N·m", "measured moment of the tool, at the tool point, world axes", width=3)]
    F_push: Annotated[Vector, Signal("N", "force with which a hand, or the scenario's push, acts on the tool", width=3)]
    moment_push: Annotated[Vector, Signal("N·m", "moment with which a hand, or the scenario's push, turns it", width=3)]
    F_c: Annotated[Vector, Signal("N", "controlled force, from the measured one", "r")]
    F_cd: Annotated[Vector, Signal("N", "desired controlled force", "r")]
    z: Annotated[Vector, Signal("m/s", "state of the compensator (9), which brings the target model into s", "r")]
    s: Annotated[Vector, Signal("m/s", "sliding variable (10): 0 means that the arm obeys the target model", "r")]
    tau_inertia: Annotated[Vector, Signal("N·m", "M_hat q_eq_ddot, (25)", "joints")]
    tau_coriolis: Annotated[Vector, Signal("N·m", "C_hat q_eq_dot, (25)", "joints")]
    tau_gravity: Annotated[Vector, Signal("N·m", "G_hat, (25)", "joints")]
    tau_force: Annotated[Vector, Signal("N·m", "J^T F, (25)", "joints")]
    tau_linear: Annotated[Vector, Signal("N·m", "-J_q^T K_s s, (25)", "joints")]
    tau_switching: Annotated[Vector, Signal("N·m", "-J_q^T d sigma(s), (25)", "joints")]
    tau: Annotated[Vector, Signal("N·m", "torque that the law asks of the drives, the sum of its terms (25)", "joints")]
    tau_applied: Annotated[
        Vector, Signal("N·m", "torque that the drives apply: tau, within truth.torque_limit", "joints")
    ]
    q_eq_ddot: Annotated[Vector, Signal("rad/s^2", "joint acceleration that the law prescribes, (25)", "joints")]
    needed: Annotated[
        Vector,
        Signal("N", f"terms of (17): {', '.join(CAUSES.values())}", of="r", width=len(CAUSES)),
    ]
    d: Annotated[Number, Signal("N", "gain of the switching term, which overcomes the perturbation", "r")]
    d_required: Annotated[
        Number, Signal("N", "least gain d by (17): the sum of what each cause of perturbation needs", "r")
    ]
    s_norm: Annotated[
        Number, Signal("m/s", "norm of the sliding variable: 0 means that the arm obeys the target model", "r")
    ]
    s_bound: Annotated[Number, Signal("m/s", "bound of ‖s‖ by the theorem, (20); none where nothing is promised", "r")]
    s_band: Annotated[
        Number, Signal("m/s", "band: the part that sampling and boundary layer add to the bound (20)", "r")
    ]
    V_band: Annotated[Number, Signal("J", "bound of V in the band: V stays below it")]
    held_error: Annotated[Number, Signal("N", "change of (25) without its robust terms within the period before", "r")]
    sigma_min: Annotated[Number, Signal("m", "smallest singular value of J_q, at most 3 % too small", "J_q")]
    residual: Annotated[Vector, Signal("N", "left side of (8) minus its right side", "r")]
    F_true: Annotated[
        Vector, Signal("N", "the force on the surface itself; F is the reading of F_true - F_push", width=3)
    ]
    moment_true: Annotated[
        Vector, Signal("N·m", "the moment on the surface itself, at the tool point, as F_true", width=3)
    ]
    multiplier: Annotated[Number, Signal("N", "true normal force per gradient of φ, (32) or (39)")]
    phi: Annotated[Number, Signal("m", "penetration of the tool into the surface")]
    multiplier_2: Annotated[Number, Signal("N", "as multiplier, of the second surface; 0 where there is none")]
    phi_2: Annotated[Number, Signal("m", "penetration of the tool into the second surface")]
    multiplier_3: Annotated[Number, Signal("N", "as multiplier, of the third surface; 0 where there is none")]
    phi_3: Annotated[Number, Signal("m", "penetration of the tool into the third surface")]

    @classmethod
    def zeros(cls, n: int) -> Row:
        """Row of n coordinates."""
        return cls._make(0.0 if signal.width == 1 else np.zeros(signal.wide(n)) for signal in SIGNALS)


def _signals() -> tuple[Signal, ...]:
    """Signals of the row, in its order; a field that is a number has width 1."""
    stated = []
    for name, hint in get_type_hints(Row, include_extras=True).items():
        (signal,), kind = hint.__metadata__, hint.__origin__
        stated.append(replace(signal, name=name, width=1 if kind is Number else signal.width))
    return tuple(stated)


SIGNALS = _signals()


def columns_of(n: int) -> dict[str, slice]:
    """Columns of each signal among the numbers of a row of n coordinates."""
    columns: dict[str, slice] = {}
    start = 0
    for signal in SIGNALS:
        columns[signal.name] = slice(start, start + signal.wide(n))
        start += signal.wide(n)
    return columns
