"""World: the surface, the contact, the force sensor, and how finely the plant is integrated."""

from __future__ import annotations

from app.dashboard.widgets.controls import Choice, Control, Desk, Number, Place, PlaceWhere, Scale, Switch, decades
from app.dashboard.widgets.text_field import TextField
from app.scenario.schema import Formula, Scenario
from app.session.snapshot import Snapshot
from controllers.modes import MODES

_SHAPES = {"plane": "plane", "cylinder": "cylinder", "sphere": "sphere", "formula": "formula"}
_SIDES = {"outside": "outside", "inside": "inside"}
_SOLID = {"where the formula < 0": "below", "where the formula > 0": "above"}

_SYNTAX = (
    '<div class="vs-note vs-wide">The surface is where this is 0; x, y, z in m, t in s, numbers, pi, + - * / ^ ( ), '
    "sin cos tan exp log sqrt tanh atan hypot.</div>"
)


def _touching(scenario: Scenario) -> bool:
    return scenario.contact.kind != "free"


def _springy(scenario: Scenario) -> bool:
    return scenario.contact.kind in ("elastic", "mass-damper-spring")


def _massive(scenario: Scenario) -> bool:
    return scenario.contact.kind == "mass-damper-spring"


def _heavy(scenario: Scenario) -> bool:
    return scenario.contact.kind in ("mass-damper-spring", "rigid")


def _foreseen(scenario: Scenario) -> bool:
    """Whether the law's reference needs a stiffness (33)."""
    return MODES[scenario.mode].on_surface and scenario.contact.kind != "rigid"


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
                Number(desk, PlaceWhere("contact.K_e", _springy), "K_e [N/m]", decades(100, 1_000_000)),
                Number(desk, PlaceWhere("controller.K_e_hat", _foreseen), "K̂_e [N/m]", decades(100, 1_000_000)),
                Number(desk, PlaceWhere("contact.B_e", _springy), "B_e [N·s/m]", decades(1, 10_000, zero=True)),
                Number(desk, PlaceWhere("contact.M_e", _massive), "M_e [kg]", decades(0.01, 100, zero=True)),
                Switch(desk, PlaceWhere("contact.unilateral", _touching), "Pushes only"),
                Number(desk, PlaceWhere("contact.friction_coulomb", _touching), "friction μ", Scale(0, 1)),
                Number(
                    desk,
                    PlaceWhere("contact.friction_viscous", _touching),
                    "viscous [N·s/m]",
                    decades(0.1, 1000, zero=True),
                ),
            ]
        self._surface = gui.add_folder("Surface")
        with self._surface:
            self._controls.append(Choice(desk, "surface", "Shape", _SHAPES))
            self._syntax = gui.add_html(_SYNTAX, visible=False)
            self._controls += [
                TextField(desk, Place("surface.text"), "0 ="),
                Choice(desk, "surface.solid", "Solid", _SOLID),
                Choice(desk, "surface.side", "Tool", _SIDES),
                Number(desk, Place("surface.origin"), "origin [m]"),
                Number(desk, Place("surface.normal"), "normal"),
                Number(desk, Place("surface.axis"), "axis"),
                Number(desk, Place("surface.reference"), "ψ = 0 towards"),
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
                Switch(desk, PlaceWhere("sensor.ideal", _heavy), "Ideal reading"),
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
        if self._surface.visible != (snapshot.surface is not None):
            self._surface.visible = snapshot.surface is not None
        typed = isinstance(snapshot.scenario.surface, Formula)
        if self._syntax.visible != typed:
            self._syntax.visible = typed
        for control in self._controls:
            control.show(snapshot)
