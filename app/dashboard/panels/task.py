"""Task panel: scenario, mode, and the desired motion and force."""

from __future__ import annotations

import viser

from app.dashboard.widgets.controls import Choice, Control, Desk, Number, Place, decades
from app.dashboard.widgets.section_controls import field_controls, kind_choice
from app.process.own_code import own_code
from app.scenario.data import shipped
from app.scenario.schema import Truth
from app.session.commands import Load
from app.session.snapshot import Snapshot
from controllers.modes import MODES
from environments.force_profiles.table import FORCE_PROFILES
from environments.trajectories.table import TRAJECTORIES

_EDITED = "edited, or one of your own"


class TaskPanel:
    """Scenario, mode, desired motion and desired force."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        gui = desk.gui
        self._scenarios = shipped()
        self._titles = {(s.title or name): name for name, s in self._scenarios.items()}
        self._scenario = gui.add_dropdown(
            "Scenario", (*self._titles, _EDITED), hint="Load one of the shipped scenarios."
        )
        self._scenario.on_update(self._load)
        self._mode = Choice(desk, "mode", "Mode", {mode.label: name for name, mode in MODES.items()})
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
                Number(desk, Place("shift.by"), "shifted by [m]"),
                Number(desk, Place("shift.duration"), "within [s]", decades(0.1, 10)),
            ]
        with gui.add_folder("Push on the tool"):
            self._controls += field_controls(desk, "truth", [Truth], {})

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
        self._note.content = f'<div class="vs-note">{mode.title}, {mode.equation}. {mode.summary}</div>'
        for control in self._controls:
            control.show(snapshot)
