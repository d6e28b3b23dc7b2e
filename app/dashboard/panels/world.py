"""World panel: surface, contact, force sensor, and the integration of the plant."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter
from typing import ClassVar

import viser

from app.dashboard.widgets.fields.controls import Control, Desk, Dropdown, NumberField, Switch
from app.dashboard.widgets.fields.field_binding import BindingWhere, FieldBinding, SliderScale, log_scale
from app.dashboard.widgets.fields.section_controls import field_control, field_controls, kind_choice
from app.scenario.own_code import own_code
from app.scenario.schema import Scenario
from app.session.snapshot import Snapshot
from app.simulation.builders.environment_checks import face_obstacle
from controllers.modes import MODES
from environments.contact_kinds import CONTACTS, ContactKind
from environments.force_profiles.table import FORCE_PROFILES
from environments.integrators import INTEGRATORS
from environments.sensors import Sensor
from environments.surfaces.table import SURFACES

_PAIRS = (
    '<div class="vs-note">Surfaces of one elastic body: the entries between 1 and 2, 1 and 3, 2 and 3 of the '
    "symmetric matrices (28), (33), whose diagonals are the numbers of each surface.</div>"
)
_SYNTAX = (
    '<div class="vs-note vs-wide">The surface is where this is 0; x, y, z in m, t in s, numbers, pi, + - * / ^ ( ), '
    "sin cos tan exp log sqrt tanh atan hypot.</div>"
)


def _springy(scenario: Scenario) -> bool:
    return scenario.contact.nature.springs


def _heavy(scenario: Scenario) -> bool:
    return any(each.contact.nature.heavy for each in scenario.surfaces)


def _foreseen(scenario: Scenario) -> bool:
    """Whether the law's reference needs the stiffness of the surface (33)."""
    return MODES[scenario.mode].on_surface and not scenario.contact.nature.rigid


def _plain(scenario: Scenario) -> bool:
    """Whether the tool is flat, or may be."""
    return scenario.face.flat or face_obstacle(scenario) is None


def _flat(scenario: Scenario) -> bool:
    return scenario.face.flat


def _aligned(scenario: Scenario) -> bool:
    """Whether the moments of a flat tool are controlled."""
    return scenario.face.flat and MODES[scenario.mode].on_surface


def _coupled(scenario: Scenario) -> bool:
    """Whether there are several surfaces with a stiffness, which may belong to one body."""
    return _springy(scenario) and len(scenario.surfaces) > 1


def _coupled_masses(scenario: Scenario) -> bool:
    return sum(each.contact.nature.massive for each in scenario.surfaces) > 1


def _coupled_estimates(scenario: Scenario) -> bool:
    return _coupled(scenario) and _foreseen(scenario)


def _contact_controls(desk: Desk, contact: str, estimate: str, foreseen: Callable[[Scenario], bool]) -> list[Control]:
    """Controls of the contact with one surface, but for the menu of its kind.
    contact: path of its section.
    estimate: path of the controller's estimate of its stiffness.
    foreseen: whether the law's reference needs that estimate."""

    def where(holds: Callable[[ContactKind], bool]) -> Callable[[Scenario], bool]:
        return lambda scenario: holds(section_of(scenario).nature)

    section_of = attrgetter(contact)
    touches = where(lambda kind: kind.touches)
    springs, massive = where(lambda kind: kind.springs), where(lambda kind: kind.massive)

    def number(field: str, applies: Callable[[Scenario], bool], label: str, scale: SliderScale) -> NumberField:
        return NumberField(desk, BindingWhere(f"{contact}.{field}", applies), label, scale)

    return [
        number("K_e", springs, "K_e [N/m]", log_scale(100, 1_000_000)),
        NumberField(desk, BindingWhere(estimate, foreseen), "K̂_e [N/m]", log_scale(100, 1_000_000)),
        number("B_e", springs, "B_e [N·s/m]", log_scale(1, 10_000, zero=True)),
        number("M_e", massive, "M_e [kg]", log_scale(0.01, 100, zero=True)),
        Switch(desk, BindingWhere(f"{contact}.unilateral", touches), "Pushes only"),
        number("friction_coulomb", touches, "friction μ", SliderScale(0, 1)),
        number("friction_viscous", touches, "viscous [N·s/m]", log_scale(0.1, 1000, zero=True)),
    ]


class WorldPanel:
    """World panel: surface and contact, the controller's estimate of the surface, sensor and integration."""

    holds: ClassVar = (
        "contact, surface, stiffness, friction, flat tool, coupling, force sensor (noise, delay), integration"
    )

    def __init__(self, desk: Desk) -> None:
        gui = desk.gui
        self._controls: list[Control] = []
        with gui.add_folder("Contact"):
            kinds = {contact.title: kind for kind, contact in CONTACTS.items()}
            self._controls += [
                Dropdown(desk, "contact.kind", "Kind", kinds),
                *_contact_controls(desk, "contact", "controller.K_e_hat", _foreseen),
            ]
        self._surface = gui.add_folder("Surface")
        with self._surface:
            self._controls.append(kind_choice(desk, "surface", "Shape", SURFACES, own_code().surfaces))
            self._syntax = gui.add_html(_SYNTAX, visible=False)
            self._controls += field_controls(desk, "surface", SURFACES, own_code().surfaces)
        self._flat_tool = gui.add_folder("Flat tool", expand_by_default=False)
        with self._flat_tool:
            self._controls += [
                Switch(desk, BindingWhere("face.flat", _plain), "Touches with a flat face"),
                field_control(desk, "face.K_t", _flat),
                field_control(desk, "face.K_t_hat", _aligned),
                field_control(desk, "face.moment", _aligned),
                field_control(desk, "face.normal", _flat),
            ]
        self._further = [self._add_further(desk, "second"), self._add_further(desk, "third")]
        self._coupling = gui.add_folder("Coupling", expand_by_default=False)
        with self._coupling:
            gui.add_html(_PAIRS)
            self._controls += [
                NumberField(desk, BindingWhere("coupling.K_e", _coupled), "K_e 12,13,23 [N/m]"),
                NumberField(desk, BindingWhere("coupling.K_e_hat", _coupled_estimates), "K̂_e 12,13,23 [N/m]"),
                NumberField(desk, BindingWhere("coupling.B_e", _coupled), "B_e 12,13,23 [N·s/m]"),
                NumberField(desk, BindingWhere("coupling.M_e", _coupled_masses), "M_e 12,13,23 [kg]"),
            ]
        with gui.add_folder("Force sensor"):
            self._controls += [
                *field_controls(desk, "sensor", [Sensor], {}),
                Switch(desk, BindingWhere("sensor.ideal", _heavy), "Ideal reading"),
            ]
        with gui.add_folder("Integration of the plant"):
            self._controls += [
                Dropdown(
                    desk,
                    "simulation.integrator",
                    "Integrator",
                    {integrator.title: name for name, integrator in INTEGRATORS.items()},
                ),
                NumberField(desk, FieldBinding("simulation.substeps"), "substeps"),
            ]

    def _add_further(self, desk: Desk, section: str) -> viser.GuiFolderHandle:
        """Folder of a further surface: its contact, and, where it has one, its shape and the force on it."""

        def there(scenario: Scenario) -> bool:
            return bool(getattr(scenario, section).present)

        def foreseen(scenario: Scenario) -> bool:
            return there(scenario) and _foreseen(scenario)

        def choosable(scenario: Scenario) -> bool:
            return there(scenario) and MODES[scenario.mode].on_surface

        def force_controlled(scenario: Scenario) -> bool:
            return choosable(scenario) and getattr(scenario, section).control == "force"

        kinds = {contact.title: kind for kind, contact in CONTACTS.items()}
        with (folder := desk.gui.add_folder(f"{section.capitalize()} surface", expand_by_default=False)):
            self._controls += [
                Dropdown(desk, f"{section}.contact.kind", "Contact", kinds),
                kind_choice(desk, f"{section}.surface", "Shape", SURFACES, own_code().surfaces, there),
                *field_controls(desk, f"{section}.surface", SURFACES, own_code().surfaces, there),
                *_contact_controls(desk, f"{section}.contact", f"{section}.K_e_hat", foreseen),
                Dropdown(
                    desk,
                    f"{section}.control",
                    "Controlled",
                    {"its normal force": "force", "the distance from it": "path"},
                    choosable,
                ),
                kind_choice(desk, f"{section}.force", "Force", FORCE_PROFILES, {}, force_controlled),
                *field_controls(desk, f"{section}.force", FORCE_PROFILES, {}, force_controlled),
            ]
        return folder

    def show(self, snapshot: Snapshot) -> None:
        met = bool(snapshot.surfaces)
        for folder in (self._surface, *self._further):
            if folder.visible != met:
                folder.visible = met
        if self._flat_tool.visible != (plain := met and _plain(snapshot.scenario)):
            self._flat_tool.visible = plain
        if self._coupling.visible != (coupled := _coupled(snapshot.scenario)):
            self._coupling.visible = coupled
        typed = snapshot.scenario.surface.typed
        if self._syntax.visible != typed:
            self._syntax.visible = typed
        for control in self._controls:
            control.show(snapshot)
