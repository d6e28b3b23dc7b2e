"""Glossary: the symbols of the page, each with one sentence, unit, equation of the paper and present value.

Sentences and units are those of the recorded signals and of the scenario's fields, wherever one of them is meant. A new
symbol is a row of `GLOSSARY`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from app.scenario.field_info import field_info
from app.scenario.number_text import short, without_rounding
from app.scenario.schema import Scenario
from app.scenario.units import CARTESIAN, JOINT, indexed
from app.simulation.signals import SIGNALS
from app.simulation.system import System
from environments.contact_kinds import ContactKind
from environments.robots import MOST_JOINTS

_SIGNALS = {signal.name: signal for signal in SIGNALS}
Where = Callable[[System], bool]
_THOUSANDTHS = ("m", "m/s", "rad", "rad/s")  # what the page shows in mm, mm/s, …


def _everywhere(_: System) -> bool:
    return True


@dataclass(frozen=True)
class Symbol:
    """Symbol of the page.
    written: as the page writes it.
    meaning: one sentence without its full stop.
    unit, joint_unit: of its value, for an arm of revolute joints, in Cartesian task coordinates and where r = q.
    equation: of the paper, "" for a symbol that is not in the paper.
    also: other words for it in titles and legends.
    signal, field: of which it is the value, "" where none is.
    where: whether it means something in a system; its signal or field may have a number nevertheless."""

    written: str
    meaning: str
    unit: str = ""
    joint_unit: str = ""
    equation: str = ""
    also: tuple[str, ...] = ()
    signal: str = ""
    field: str = ""
    where: Where = _everywhere

    def value(self, row: Mapping[str, np.ndarray], system: System, model: Mapping[str, np.ndarray]) -> str:
        """Present value of the symbol with its unit; "" where there is none.
        row: recorded signals of one instant.
        model: the matrices of (8) in force, each (n, n)."""
        if not self.where(system):
            return ""
        if self.signal:
            value = np.atleast_1d(row[self.signal]).astype(float)
        elif self.written in model:
            value = np.diag(model[self.written])
        else:
            value = _of_field(self.field, system.scenario)
        if value is None or not len(value) or not np.isfinite(value).all():
            return ""
        if self.signal:
            units = _SIGNALS[self.signal].units_in(system.units, system.robot.slides)
            value = np.where([unit in _THOUSANDTHS for unit in units], 1e3 * value, value)
            units = [f"m{unit}" if unit in _THOUSANDTHS else unit for unit in units]
        else:
            units = [field_info(self.field).unit_in(system.units)] * len(value)
        units = [unit.removesuffix("1") for unit in units]
        if len(set(units)) > 1:
            return ", ".join(f"{_short(number)} {unit}" for number, unit in zip(value, units, strict=True))
        if len(value) > 1 and bool((value == value[0]).all()):
            return f"{_short(value[0])} {units[0]}".strip() + ", each"
        text = ", ".join(_short(number) for number in value)
        return f"{text} {units[0]}".strip()


def _of_field(path: str, scenario: Scenario) -> np.ndarray | None:
    """Numbers of a field; None where it has none."""
    value: object = scenario
    for name in path.split(".") if path else ():
        value = getattr(value, name, None)
    if not isinstance(value, int | float | tuple):
        return None
    return np.ravel(np.array(value, dtype=float))


def _short(number: float) -> str:
    return short(without_rounding(number, 1e-6))


def _robust(system: System) -> bool:
    return system.controller.law.robust


def _layered(system: System) -> bool:
    return system.controller.has_layer


def _meets(number: int, holds: Callable[[ContactKind], bool] = lambda kind: kind.touches) -> Where:
    """Where the world has the surface of this number, from 0, and this holds of its contact."""

    def where(system: System) -> bool:
        surfaces = system.scenario.surfaces
        return number < len(surfaces) and holds(surfaces[number].contact.nature)

    return where


def _foreseen(system: System) -> bool:
    """Where the law's reference needs the stiffness of the surface (33)."""
    return system.mode.on_surface and not system.scenario.contact.nature.rigid


def _flat(system: System) -> bool:
    return system.scenario.face.flat


def _aligned(system: System) -> bool:
    return _flat(system) and system.mode.on_surface


def _turning(system: System) -> bool:
    """Where a coordinate is an angle times ℓ."""
    return any(each.metres_per_radian is not None for each in system.coordinates)


def _signal(written: str, signal: str, equation: str, *also: str, where: Where = _everywhere) -> Symbol:
    of = _SIGNALS[signal]
    unit = of.unit_in(JOINT)
    joint_unit = "" if unit == of.unit else unit
    return Symbol(written, of.doc, of.unit, joint_unit, equation, also, signal=signal, where=where)


def _field(written: str, path: str, equation: str, *also: str, where: Where = _everywhere) -> Symbol:
    of = field_info(path)
    units = of.unit_in(CARTESIAN), of.unit_in(JOINT)
    return Symbol(written, of.doc, *units, equation, also, field=path, where=where)


def _own(written: str, meaning: str, equation: str = "", unit: str = "", also: tuple[str, ...] = ()) -> Symbol:
    return Symbol(written, meaning, unit, "", equation, also)


GLOSSARY: tuple[Symbol, ...] = (
    _field("M_m", "target_model.M_m", "(8)"),
    _field("B_m", "target_model.B_m", "(8)"),
    _field("K_m", "target_model.K_m", "(8)"),
    _field("K_f", "target_model.K_f", "(8)"),
    _signal("r", "r", "(3)"),
    _signal("r_d", "r_d", "(8)"),
    _signal("e_r", "e_r", "(8)", "tracking error", "position error", "rotation error", "joint error"),
    _signal("ė_r", "e_r_dot", "(8)"),
    _own("ë_r", "second derivative of the tracking error", "(8)", "m/s²"),
    _own("e_F", "force error F_c − F_cd: measured minus desired", "(8)", "N", ("e_Fc",)),
    _signal("F_c", "F_c", "(8)", "measured normal"),
    _signal("F_cd", "F_cd", "(8)", "desired normal"),
    _signal("F", "F", "(2)", "force on the environment"),
    _signal("M", "moment", "(2)", "moment on the environment"),
    _signal("q", "q", "(3)", *(indexed("q", joint) for joint in range(1, MOST_JOINTS + 1))),
    _own("ℓ·θ", "rotation of the tool of a planar arm, times ℓ", "(3)", "m", ("θ",)),
    _own("ℓ·α", "rotation of the tool about its own x axis at the start, times ℓ", "(3)", "m", ("α",)),
    _own("ℓ·β", "rotation of the tool about its own y axis at the start, times ℓ", "(3)", "m", ("β",)),
    _own("ℓ·γ", "rotation of the tool about its own z axis at the start, times ℓ", "(3)", "m", ("γ",)),
    _own("ℓ·θ₁", "sine of the tilt of the flat tool's first axis against the plane, times ℓ", "(30)", "m", ("θ₁",)),
    _own("ℓ·θ₂", "sine of the tilt of the flat tool's second axis against the plane, times ℓ", "(30)", "m", ("θ₂",)),
    _field("K_t", "face.K_t", "(32)", where=_flat),
    _field("K̂_t", "face.K_t_hat", "(33)", where=_aligned),
    _field("ℓ", "task_space.characteristic_length", "", "characteristic length", where=_turning),
    _signal("φ", "phi", "(30)", "penetration", "φ₁", where=_meets(0)),
    _signal("φ₂", "phi_2", "(30)", where=_meets(1)),
    _signal("φ₃", "phi_3", "(30)", where=_meets(2)),
    _own("ψ₁", "first coordinate of the tool along the surface", "(31)", "m"),
    _own("ψ₂", "second coordinate of the tool along the surface", "(31)", "m"),
    _own("ψ", "coordinate of the tool along the edge of two surfaces", "(31)", "m"),
    _own("x", "coordinate of the tool along the task frame's x axis, or force along the world's", "(3)", "m"),
    _own("y", "coordinate of the tool along the task frame's y axis, or force along the world's", "(3)", "m"),
    _own("z", "coordinate of the tool along the task frame's z axis, or force along the world's", "(3)", "m"),
    _own("z(0)", "initial state of the compensator", "(9)", "m/s"),
    _signal("s", "s", "(10)", where=_robust),
    _signal("‖s‖", "s_norm", "(10)", "sliding variable", where=_robust),
    _signal("(20)", "s_bound", "(20)", "bound", where=_robust),
    _signal("band", "s_band", "", where=_robust),
    _signal("d", "d", "(17)", "gain d", where=_robust),
    _signal("(17)", "d_required", "(17)", "needed", where=_robust),
    _own("(8)", "target model: the second-order system that the arm shall behave like", "(8)"),
    _own("(18)", "reaching time: the latest time at which s becomes 0, in continuous time", "(18)", "s"),
    _own("(24)", "bound of the Lyapunov function V", "(24)", "J"),
    _own("(25)", "control law: torque from the estimates of the arm, the force, and the robust terms", "(25)", "N·m"),
    _own(
        "(37)",
        "steady force error of the target model where the estimate of the surface's stiffness is wrong",
        "(37)",
        "N",
    ),
    _own("V", "Lyapunov function of the proof, ½ sᵀHs", "(21)", "J", ("Lyapunov function",)),
    _field("ε", "controller.epsilon", "(17)", where=_robust),
    _field("K_s", "controller.K_s", "(15)", where=_robust),
    _field("F_1", "controller.F_1", "(10)", where=_robust),
    _field("F_2", "controller.F_2", "(10)", where=_robust),
    _field("A", "controller.A", "(9)", where=_robust),
    _field("layer s_b", "controller.layer", "", "boundary layer", "layer", where=_layered),
    _field("T", "controller.period", "", "period"),
    _field("K_e", "contact.K_e", "(32)", where=_meets(0, lambda kind: kind.springs)),
    _field("B_e", "contact.B_e", "(28)", where=_meets(0, lambda kind: kind.springs)),
    _field("M_e", "contact.M_e", "(28)", where=_meets(0, lambda kind: kind.massive)),
    _field("K̂_e", "controller.K_e_hat", "(33)", where=_foreseen),
    _signal("τ", "tau", "(25)", "joint torque"),
    _signal("λ", "multiplier", "(39)", where=_meets(0)),
    _signal("λ₂", "multiplier_2", "(39)", where=_meets(1)),
    _signal("λ₃", "multiplier_3", "(39)", where=_meets(2)),
    _signal("σ_min(J_q)", "sigma_min", "(3)", "σmin(Jq)"),
    _own("J_q", "Jacobian of the task coordinates", "(3)"),
    _own("H", "inertia of the true arm in task coordinates", "(4)", "kg"),
    _own("Ĥ", "inertia of the arm in task coordinates, as the controller estimates it", "(6)", "kg"),
    _own("residual", "left side of (8) minus its right side: how far the arm is from the target model", "(8)", "N"),
    _signal("push", "F_push", ""),
    _own("Ω", "set of postures for which the theorem's constants were found; J_q is singular nowhere in it", "(1)"),
)
