"""Robot panel: the arm, the true arm, and the declared bounds."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from app.dashboard.widgets.families.arm_choice import ArmChoice, ArmVerdict, InForce, ToolFrame, Upload, UrdfBinding
from app.dashboard.widgets.fields.controls import Control, Desk, NumberField
from app.dashboard.widgets.fields.field_binding import BindingWhere, FieldBinding, SliderScale, log_scale
from app.dashboard.widgets.fields.matrix_text import number
from app.dashboard.widgets.fields.text_field import TextField
from app.scenario.schema import Scenario
from app.session.commands import Edit, EditModel
from app.session.snapshot import Snapshot

UNSTATED = "from the above"


class StatedBounds(FieldBinding):
    """Binding of a bound of (7), whose value is shown as text: a number, a formula, or what the bound follows from."""

    def read(self, snapshot: Snapshot) -> str:
        value = super().read(snapshot)
        return UNSTATED if value is None else value if isinstance(value, str) else f"{value:.6g}"

    def edit(self, snapshot: Snapshot, value: Any) -> Edit | EditModel:
        text = str(value).strip()
        try:
            return super().edit(snapshot, None if text == UNSTATED else number(text))
        except ValueError:  # the text is a formula, or the runner refuses it with a reason
            return super().edit(snapshot, text)


def _inertia_stated(scenario: Scenario) -> bool:
    return scenario.declared.delta_M is not None


class RobotPanel:
    """Robot panel: the arm, then the verdict, the true arm and the declared bounds."""

    holds: ClassVar = "the true arm, masses, bounds declared or stated as in (7), tool and posture, own URDF"

    def __init__(self, desk: Desk) -> None:
        gui = desk.gui
        self._controls: list[Control] = [ArmChoice(desk), ArmVerdict(desk)]
        with gui.add_folder("The true arm"):
            self._controls += [
                NumberField(desk, InForce("truth.link_scaling", _common_scaling), "links ×", SliderScale(0.5, 1.5)),
                NumberField(desk, InForce("truth.link_scaling", _scalings), "link by link ×"),
                NumberField(desk, InForce("truth.rotor_scaling", _common_rotor), "rotors ×", SliderScale(0.5, 1.5)),
                NumberField(desk, InForce("truth.rotor_scaling", _rotor_scalings), "rotor by rotor ×"),
                NumberField(desk, FieldBinding("truth.link_centre"), "centre shifts [m]"),
                NumberField(desk, FieldBinding("truth.link_shape"), "shape changes"),
                NumberField(desk, FieldBinding("truth.payload_mass"), "payload [kg]", SliderScale(0, 5)),
                NumberField(desk, FieldBinding("truth.payload_offset"), "payload at [m]"),
                NumberField(desk, FieldBinding("truth.coulomb"), "Coulomb [N·m]", SliderScale(0, 10)),
                NumberField(desk, FieldBinding("truth.viscous"), "viscous [N·m·s]", SliderScale(0, 10)),
                NumberField(desk, FieldBinding("truth.torque_limit"), "torque limit ×", SliderScale(0, 2)),
                NumberField(desk, FieldBinding("truth.disturbance"), "disturbance [N·m]", SliderScale(0, 20)),
                NumberField(desk, FieldBinding("truth.disturbance_frequency"), "its frequency [Hz]", SliderScale(0, 5)),
            ]
        with gui.add_folder("Bounds declared to the controller"):
            self._controls += [
                NumberField(desk, FieldBinding("declared.link_scaling"), "links 1 ±", SliderScale(0, 0.5)),
                NumberField(desk, FieldBinding("declared.rotor_scaling"), "rotors 1 ±", SliderScale(0, 0.5)),
                NumberField(desk, FieldBinding("declared.link_centre"), "centre shift [m]", SliderScale(0, 0.05)),
                NumberField(desk, FieldBinding("declared.link_shape"), "shapes 1 ±", SliderScale(0, 0.5)),
                NumberField(desk, FieldBinding("declared.payload_mass"), "payload [kg]", SliderScale(0, 5)),
                NumberField(desk, FieldBinding("declared.payload_offset"), "payload shift [m]", SliderScale(0, 0.3)),
                NumberField(desk, FieldBinding("declared.coulomb"), "Coulomb [N·m]", SliderScale(0, 10)),
                NumberField(desk, FieldBinding("declared.viscous"), "viscous [N·m·s]", SliderScale(0, 10)),
                NumberField(desk, FieldBinding("declared.disturbance"), "disturbance [N·m]", SliderScale(0, 20)),
                NumberField(desk, FieldBinding("declared.force_error"), "force error [N]", SliderScale(0, 5)),
                NumberField(desk, FieldBinding("declared.moment_error"), "moment error [N·m]", SliderScale(0, 1)),
            ]
        with gui.add_folder("Bounds stated instead, as in (7)"):
            self._controls += [
                TextField(desk, StatedBounds("declared.delta_M"), "δ_M [kg·m²]"),
                TextField(desk, StatedBounds("declared.delta_C"), "δ_C [kg·m²/s]"),
                TextField(desk, StatedBounds("declared.delta_G"), "δ_G [N·m]"),
                TextField(desk, StatedBounds("declared.delta_f"), "δ_f [N·m]"),
                NumberField(
                    desk, BindingWhere("declared.least_inertia", _inertia_stated), "M ≥ M̂ ×", SliderScale(0.05, 1)
                ),
            ]
        with gui.add_folder("Tool and posture"):
            self._controls += [
                ToolFrame(desk),
                NumberField(desk, InForce("robot.tool_offset", _tool_offset), "tool at [m]"),
                NumberField(desk, InForce("robot.posture", _posture), "posture [rad]"),
                NumberField(desk, InForce("robot.rotor_inertia", _rotors), "rotors [kg·m²]"),
                NumberField(desk, FieldBinding("task_space.characteristic_length"), "length ℓ [m]", log_scale(0.02, 1)),
            ]
        with gui.add_folder("Own URDF"):
            self._controls += [Upload(desk), TextField(desk, UrdfBinding(), "path")]

    def show(self, snapshot: Snapshot) -> None:
        for control in self._controls:
            control.show(snapshot)


def _tool_offset(snapshot: Snapshot) -> tuple[float, ...]:
    return tuple(snapshot.robot.tool_offset.tolist())


def _posture(snapshot: Snapshot) -> tuple[float, ...]:
    return tuple(snapshot.robot.posture.tolist())


def _rotors(snapshot: Snapshot) -> tuple[float, ...]:
    return tuple(snapshot.robot.model.armature.tolist())


def _common_scaling(snapshot: Snapshot) -> Any:
    """Common factor of all links; None, which hides the row, where links have factors of their own."""
    return _common(snapshot.scenario.truth.link_scaling)


def _common_rotor(snapshot: Snapshot) -> Any:
    """Common factor of the rotors' inertias; None, which hides the row, where joints have factors of their own."""
    return _common(snapshot.scenario.truth.rotor_scaling)


def _common(scaling: float | tuple[float, ...]) -> Any:
    return scaling if np.ndim(scaling) == 0 else None


def _scalings(snapshot: Snapshot) -> tuple[float, ...]:
    return tuple(np.broadcast_to(snapshot.scenario.truth.link_scaling, snapshot.robot.n).tolist())


def _rotor_scalings(snapshot: Snapshot) -> tuple[float, ...]:
    return tuple(np.broadcast_to(snapshot.scenario.truth.rotor_scaling, snapshot.robot.n).tolist())
