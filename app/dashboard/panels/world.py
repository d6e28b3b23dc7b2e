"""World: the surface, the contact, the force sensor, and how finely the plant is integrated."""

from __future__ import annotations

from app.dashboard.controls import Choice, Control, Desk, Number, Place, Scale, Switch, decades
from app.runner import Snapshot


class WorldPanel:
    """What the tool meets, and what the controller believes of it."""

    def __init__(self, desk: Desk) -> None:
        gui = desk.gui
        self._controls: list[Control] = []
        with gui.add_folder("Contact"):
            kinds = {
                "none": "free",
                "elastic": "elastic",
                "mass, damper, spring": "mass-damper-spring",
                "rigid": "rigid",
            }
            self._controls += [
                Choice(desk, "contact.kind", "Kind", kinds),
                Number(desk, Place("contact.K_e"), "K_e [N/m]", decades(100, 1_000_000)),
                Number(desk, Place("controller.K_e_hat"), "K̂_e [N/m]", decades(100, 1_000_000)),
                Number(desk, Place("contact.B_e"), "B_e [N·s/m]", decades(1, 10_000, zero=True)),
                Number(desk, Place("contact.M_e"), "M_e [kg]", decades(0.01, 100, zero=True)),
                Switch(desk, "contact.unilateral", "Pushes only"),
                Number(desk, Place("contact.friction_coulomb"), "friction μ", Scale(0, 1)),
                Number(desk, Place("contact.friction_viscous"), "viscous [N·s/m]", decades(0.1, 1000, zero=True)),
            ]
        with gui.add_folder("Surface"):
            self._controls += [
                Choice(desk, "surface", "Shape", {"plane": "plane", "cylinder": "cylinder", "sphere": "sphere"}),
                Number(desk, Place("surface.origin"), "origin [m]"),
                Number(desk, Place("surface.radius"), "radius [m]", decades(0.05, 2)),
                Number(desk, Place("surface.motion.amplitude"), "moves by [m]", Scale(0, 0.05)),
                Number(desk, Place("surface.motion.frequency"), "at [Hz]", Scale(0, 2)),
                Number(desk, Place("surface.motion.direction"), "direction"),
            ]
        with gui.add_folder("Force sensor"):
            self._controls += [
                Number(desk, Place("sensor.noise"), "noise [N]", decades(0.01, 10, zero=True)),
                Number(desk, Place("sensor.delay"), "delay [s]", decades(1e-3, 0.1, zero=True)),
                Number(desk, Place("sensor.cutoff"), "low-pass [Hz]", decades(1, 1000, zero=True)),
                Switch(desk, "sensor.ideal", "Ideal reading"),
            ]
        with gui.add_folder("Integration of the plant"):
            self._controls += [
                Choice(
                    desk,
                    "simulation.integrator",
                    "Integrator",
                    {"semi-implicit Euler": "semi-implicit-euler", "Runge-Kutta 4": "rk4"},
                ),
                Number(desk, Place("simulation.substeps"), "substeps"),
            ]

    def show(self, snapshot: Snapshot) -> None:
        for control in self._controls:
            control.show(snapshot)
