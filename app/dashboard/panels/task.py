"""Task panel: scenario, mode, and the desired motion and force."""

from __future__ import annotations

from html import escape
from typing import Any

import viser

from app.dashboard.widgets.controls import Control, Desk, Dropdown, FieldPlace, NumberField, PlaceWhere, decades
from app.dashboard.widgets.equation import told_of_mode
from app.dashboard.widgets.section_controls import field_controls, kind_choice
from app.process.own_code import own_code
from app.scenario.data import shipped
from app.scenario.schema import Scenario, TruthSection
from app.session.commands import Edit, Load
from app.session.snapshot import Snapshot
from controllers.modes import MODES
from environments.force_profiles.table import FORCE_PROFILES
from environments.trajectories.table import ROTATIONS, TRAJECTORIES

_EDITED = "edited, or one of your own"


def _in_axes(scenario: Scenario) -> bool:
    return scenario.task_space.kind == "cartesian" and not MODES[scenario.mode].on_surface


class Supplemental(FieldPlace):
    """Place of the supplemental joints in force: their numbers, from 1; 0 stands for those of the arm."""

    def read(self, snapshot: Snapshot) -> tuple[int, ...] | None:
        layout = snapshot.system.layout
        if layout.joint:
            return None
        return tuple(joint + 1 for joint in layout.supplemental_joints)

    def edit(self, snapshot: Snapshot, value: Any) -> Edit:
        del snapshot
        joints = value if isinstance(value, list) else [value]
        return Edit(self.path, None if joints == [0] else joints)


class TaskPanel:
    """Task panel: scenario, mode, desired motion and desired force."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        gui = desk.gui
        self._scenarios = shipped()
        self._titles = {(s.title or name): name for name, s in self._scenarios.items()}
        self._scenario = gui.add_dropdown(
            "Scenario", (*self._titles, _EDITED), hint="Load one of the shipped scenarios."
        )
        self._scenario.on_update(self._load)
        self._mode = Dropdown(desk, "mode", "Mode", {mode.label: name for name, mode in MODES.items()})
        self._note = gui.add_html("")
        self._controls: list[Control] = [self._mode]
        self._force = gui.add_folder("Desired force")
        with self._force:
            self._controls.append(kind_choice(desk, "force", "Profile", FORCE_PROFILES, {}))
            self._controls += field_controls(desk, "force", FORCE_PROFILES, {})
        with gui.add_folder("Desired motion"):
            paths = own_code().trajectories
            self._controls += [
                kind_choice(desk, "motion", "Path", TRAJECTORIES, paths),
                *field_controls(desk, "motion", TRAJECTORIES, paths),
                NumberField(desk, FieldPlace("shift.by"), "shifted by [m]"),
                NumberField(desk, FieldPlace("shift.duration"), "within [s]", decades(0.1, 10)),
            ]
        self._rotation = gui.add_folder("Desired rotation")
        with self._rotation:
            self._controls += [
                kind_choice(desk, "rotation", "Angles", ROTATIONS, {}),
                *field_controls(desk, "rotation", ROTATIONS, {}),
            ]
            gui.add_html(
                '<div class="vs-note">Of the tool about its axes, α, β, γ, then of supplemental joints, each from its '
                "start.</div>"
            )
        with gui.add_folder("Task coordinates"):
            kinds = {"the tool's place": "cartesian", "the joints, r = q": "joint"}
            self._controls += [
                Dropdown(desk, "task_space.kind", "r", kinds),
                NumberField(desk, PlaceWhere("task_space.axes", _in_axes), "axes by [rad]"),
                NumberField(desk, Supplemental("task_space.supplemental"), "joints in r"),
            ]
        with gui.add_folder("Push on the tool"):
            self._controls += field_controls(desk, "truth", [TruthSection], {})

    async def _load(self, event: viser.GuiEvent) -> None:
        if event.client is not None and self._scenario.value != _EDITED:
            self._desk.post(Load(self._scenarios[self._titles[self._scenario.value]]))

    def show(self, snapshot: Snapshot) -> None:
        scenario = snapshot.scenario
        shipped = self._scenarios.get(scenario.name) == scenario
        self._scenario.value = (scenario.title or scenario.name) if shipped else _EDITED
        mode = MODES[snapshot.scenario.mode]
        if self._force.visible != mode.on_surface:
            self._force.visible = mode.on_surface
        if self._rotation.visible == snapshot.system.layout.joint:
            self._rotation.visible = not snapshot.system.layout.joint
        told = escape(told_of_mode(snapshot))
        self._note.content = f'<div class="vs-note">{mode.title}, {mode.equation}. {told}</div>'
        for control in self._controls:
            control.show(snapshot)
