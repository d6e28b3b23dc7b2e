"""Task panel: scenario, mode, and the desired motion and force."""

from __future__ import annotations

from html import escape
from typing import Any, ClassVar

from app.dashboard.transport.page_values import PageEvent, from_pages
from app.dashboard.widgets.fields.controls import Control, Desk, Dropdown, NumberField
from app.dashboard.widgets.fields.field_binding import BindingWhere, FieldBinding, log_scale
from app.dashboard.widgets.fields.matrix_text import written
from app.dashboard.widgets.fields.section_controls import field_controls, kind_choice
from app.dashboard.widgets.target_model.equation import mode_summary
from app.scenario.caption import title_of
from app.scenario.data import shipped
from app.scenario.own_code import own_code
from app.scenario.schema import Scenario, TruthSection
from app.session.commands import BeginScenario, Edit
from app.session.snapshot import Snapshot
from controllers.modes import MODES
from environments.force_profiles.table import FORCE_PROFILES
from environments.trajectories.table import ROTATIONS, TRAJECTORIES

_MODE = (
    "In which directions the tool follows a path and in which it presses with a force, and how it yields: one of the "
    f"applications of section IV, each with its own target model. Keys: 1 to {len(MODES)}"
)
_COUNTS = {1: "one number", 2: "two numbers", 3: "three numbers"}
_PROFILE = "How the desired force goes over time."
_PATH = "Along which path the tool is to move."
_ANGLES = "Which path the angles take: the tool keeps its direction, or turns."


def _in_axes(scenario: Scenario) -> bool:
    return scenario.task_space.kind == "cartesian" and not MODES[scenario.mode].on_surface


class Supplemental(FieldBinding):
    """Binding of the supplemental joints in force: their numbers, from 1; 0 stands for those of the arm."""

    def read(self, snapshot: Snapshot) -> tuple[int, ...] | None:
        layout = snapshot.system.layout
        if layout.joint:
            return None
        return tuple(joint + 1 for joint in layout.supplemental_joints)

    def edit(self, snapshot: Snapshot, value: Any) -> Edit:
        del snapshot
        joints = value if isinstance(value, list) else [value]
        return Edit(self.path, None if joints == [0] else joints)


class Shift(FieldBinding):
    """Binding of the shift: a number for each coordinate that it can move, also for those left out of the list."""

    def read(self, snapshot: Snapshot) -> tuple[float, ...] | None:
        by, free = snapshot.scenario.shift.by, _moved(snapshot)
        return (*by, *[0.0] * (free - len(by))) if free else None

    def edit(self, snapshot: Snapshot, value: Any) -> Edit:
        free = _moved(snapshot)
        by = list(value) if isinstance(value, list | tuple) else [value]
        if len(by) != free:
            example = written((0.02, *[0.0] * (free - 1)))
            raise ValueError(f"{written(by)}; allowed: {_COUNTS.get(free, f'{free} numbers')}, such as {example}")
        return Edit(self.path, by)


def _moved(snapshot: Snapshot) -> int:
    """Number of the coordinates that a shift moves."""
    system = snapshot.system
    return (system.layout.n if system.layout.joint else system.layout.end_of_positions) - system.m


class TaskPanel:
    """Task panel: scenario, mode, desired motion and desired force."""

    holds: ClassVar = (
        "scenario, mode, desired force, desired motion, desired rotation, task coordinates, push on the tool"
    )

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        gui = desk.gui
        self._scenarios = shipped()
        self._titles = {(s.title or name): name for name, s in self._scenarios.items()}
        self._scenario = gui.add_dropdown(
            "Scenario", tuple(self._titles), hint="One of the shipped scenarios: it starts at once, at t = 0."
        )
        self._scenario.on_update(from_pages(self._load))
        modes = {mode.label: name for name, mode in MODES.items()}
        self._mode = Dropdown(desk, "mode", "Mode", modes, hint=_MODE)
        self._note = gui.add_html("")
        self._controls: list[Control] = [self._mode]
        self._force = gui.add_folder("Desired force")
        with self._force:
            self._controls.append(kind_choice(desk, "force", "Profile", FORCE_PROFILES, {}, hint=_PROFILE))
            self._controls += field_controls(desk, "force", FORCE_PROFILES, {})
        with gui.add_folder("Desired motion"):
            paths = own_code().trajectories
            self._controls += [
                kind_choice(desk, "motion", "Path", TRAJECTORIES, paths, hint=_PATH),
                *field_controls(desk, "motion", TRAJECTORIES, paths),
                NumberField(desk, Shift("shift.by"), "shifted by [m]"),
                NumberField(desk, FieldBinding("shift.duration"), "within [s]", log_scale(0.1, 10)),
            ]
        self._rotation = gui.add_folder("Desired rotation")
        with self._rotation:
            self._controls += [
                kind_choice(desk, "rotation", "Angles", ROTATIONS, {}, hint=_ANGLES),
                *field_controls(desk, "rotation", ROTATIONS, {}),
            ]
            gui.add_html(
                '<div class="vs-note">Angles of the tool about its axes, α, β, γ, then of supplemental joints '
                "(prismatic ones in m), each from its start.</div>"
            )
        with gui.add_folder("Task coordinates"):
            kinds = {"the tool's place": "cartesian", "the joints, r = q": "joint"}
            self._controls += [
                Dropdown(desk, "task_space.kind", "r", kinds),
                NumberField(desk, BindingWhere("task_space.axes", _in_axes), "axes by [rad]"),
                NumberField(desk, Supplemental("task_space.supplemental"), "joints in r"),
            ]
        with gui.add_folder("Push on the tool"):
            self._controls += field_controls(desk, "truth", [TruthSection], {})

    async def _load(self, _: PageEvent) -> None:
        if (name := self._titles.get(self._scenario.value)) is not None:
            self._desk.post(BeginScenario(self._scenarios[name]))

    def show(self, snapshot: Snapshot) -> None:
        self._show_scenario(snapshot.scenario)
        mode = MODES[snapshot.scenario.mode]
        if self._force.visible != mode.on_surface:
            self._force.visible = mode.on_surface
        if self._rotation.visible == snapshot.system.layout.joint:
            self._rotation.visible = not snapshot.system.layout.joint
        summary = escape(mode_summary(snapshot))
        self._note.content = f'<div class="vs-note">{mode.title}, {mode.equation}. {summary}</div>'
        for control in self._controls:
            control.show(snapshot)

    def _show_scenario(self, scenario: Scenario) -> None:
        """Show which scenario runs. The entry for one that is not shipped is there only while it runs: to choose it
        would do nothing."""
        begun_from = self._scenarios.get(scenario.name)
        if begun_from == scenario:
            title, options = scenario.title or scenario.name, tuple(self._titles)
        else:
            own = title_of(scenario, begun_from)
            title = f"{own.text}, edited" if own.edited or own.text in self._titles else own.text
            options = (*self._titles, title)
        # viser chooses the first entry where the chosen one goes
        if title not in self._scenario.options:
            self._scenario.options = (*self._scenario.options, title)
        self._scenario.value = title
        if self._scenario.options != options:
            self._scenario.options = options
