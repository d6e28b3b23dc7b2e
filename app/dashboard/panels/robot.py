"""Robot: the arm, how it truly is, and what the controller was told."""

from __future__ import annotations

from app.dashboard.controls import Choice, Control, Desk, Number, Place, Scale, decades
from app.runner import Snapshot
from environments.robots import CATALOGUE


class RobotPanel:
    """The arm; truth and declaration side by side."""

    def __init__(self, desk: Desk) -> None:
        gui = desk.gui
        arms = {entry.title: name for name, entry in CATALOGUE.items()}
        self._controls: list[Control] = [
            Choice(desk, "robot.name", "Arm", arms),
            Number(desk, Place("task_space.characteristic_length"), "length l [m]", decades(0.02, 1)),
        ]
        with gui.add_folder("The true arm"):
            self._controls += [
                Number(desk, Place("truth.link_scaling"), "links ×", Scale(0.5, 1.5)),
                Number(desk, Place("truth.payload_mass"), "payload [kg]", Scale(0, 5)),
                Number(desk, Place("truth.coulomb"), "Coulomb [N·m]", Scale(0, 10)),
                Number(desk, Place("truth.viscous"), "viscous [N·m·s]", Scale(0, 10)),
                Number(desk, Place("truth.disturbance"), "push [N·m]", Scale(0, 20)),
                Number(desk, Place("truth.disturbance_frequency"), "push at [Hz]", Scale(0, 5)),
            ]
        with gui.add_folder("Declared to the controller, at most"):
            self._controls += [
                Number(desk, Place("declared.link_scaling"), "links 1 ±", Scale(0, 0.5)),
                Number(desk, Place("declared.payload_mass"), "payload [kg]", Scale(0, 5)),
                Number(desk, Place("declared.coulomb"), "Coulomb [N·m]", Scale(0, 10)),
                Number(desk, Place("declared.viscous"), "viscous [N·m·s]", Scale(0, 10)),
                Number(desk, Place("declared.disturbance"), "push [N·m]", Scale(0, 20)),
                Number(desk, Place("declared.force_error"), "force error [N]", Scale(0, 5)),
            ]

    def show(self, snapshot: Snapshot) -> None:
        for control in self._controls:
            control.show(snapshot)
