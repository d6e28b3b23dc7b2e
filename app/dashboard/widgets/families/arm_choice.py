"""Choice of the arm: a row of the catalogue or any URDF; its tool frame; the verdict on the declared bounds."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
import viser

from app.dashboard.transport.page_values import PageEvent, from_pages
from app.dashboard.widgets.chips import chip
from app.dashboard.widgets.fields.controls import AwaitedAnswer, Desk, asked
from app.dashboard.widgets.fields.field_binding import FieldBinding
from app.scenario.errors import ScenarioError
from app.scenario.units import listed
from app.session.commands import Edit, EditModel
from app.session.snapshot import Snapshot
from environments.catalogue import CATALOGUE

OWN = "own URDF"


@dataclass(frozen=True)
class InForce(FieldBinding):
    """Binding of a field whose value in force cannot be read from the scenario, where it may be left out or be
    written in several ways. of: returns the value in force."""

    of: Callable[[Snapshot], Any]

    def read(self, snapshot: Snapshot) -> Any:
        return self.of(snapshot)


class ArmChoice:
    """Dropdown of the catalogue's arms; `OWN` while a URDF runs."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._answer = AwaitedAnswer()
        self._names = {entry.title: name for name, entry in CATALOGUE.items()}
        self._dropdown = desk.gui.add_dropdown("Arm", (*self._names, OWN), hint="row of the catalogue, or a URDF")
        self._dropdown.on_update(from_pages(self._on_update))
        self._note = desk.gui.add_html("")

    async def _on_update(self, _: PageEvent) -> None:
        snapshot, chosen = self._desk.snapshot(), self._dropdown.value
        if chosen in self._names:
            asked(self._desk, snapshot, Edit("robot.name", self._names[chosen]), self._answer)
        elif snapshot.scenario.robot.urdf is None:
            self._desk.post(Edit("robot.urdf", ""))

    def show(self, snapshot: Snapshot) -> None:
        robot = snapshot.robot
        text = f"{escape(robot.title)}: {robot.n} joints; rotor inertia: {escape(robot.rotor_source)}"
        self._note.content = f'<div class="vs-note">{text}</div>'
        if not self._answer.awaited(snapshot):
            own = snapshot.scenario.robot.urdf is not None
            self._dropdown.value = OWN if own else CATALOGUE[snapshot.scenario.robot.name].title


class Upload:
    """Button for a URDF from the user's computer: the file is stored on this machine, then run."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        hint = "This file becomes the arm. It is kept on the computer that runs the dashboard, without its meshes."
        button = desk.gui.add_upload_button(
            "Upload a URDF", icon=viser.Icon.UPLOAD, hint=hint, mime_type=".urdf,.xml,application/xml"
        )
        button.on_upload(self._on_upload)

    async def _on_upload(self, event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
        file = event.target.value
        try:
            path = await asyncio.to_thread(self._desk.uploads.keep, file.name, file.content)
        except ScenarioError as error:
            self._desk.complain(str(error))
        else:
            self._desk.post(Edit("robot.urdf", str(path)))

    def show(self, snapshot: Snapshot) -> None:
        """Do nothing: the button does not depend on the run."""


class UrdfBinding(FieldBinding):
    """Binding of the path of the running URDF, on the computer that runs the dashboard; empty for an arm of the
    catalogue."""

    def __init__(self) -> None:
        super().__init__("robot.urdf")

    def read(self, snapshot: Snapshot) -> str:
        return super().read(snapshot) or ""

    def edit(self, snapshot: Snapshot, value: Any) -> Edit | EditModel:
        return super().edit(snapshot, str(value).strip())


class ToolFrame:
    """Dropdown of the arm's links, of which one is the tool."""

    def __init__(self, desk: Desk) -> None:
        self._desk, self._answer = desk, AwaitedAnswer()
        binding = FieldBinding("robot.tool_frame")
        self._dropdown: viser.GuiDropdownHandle[str] = desk.gui.add_dropdown("Tool frame", ["—"], hint=binding.hint)
        self._dropdown.on_update(from_pages(self._on_update))

    async def _on_update(self, _: PageEvent) -> None:
        asked(self._desk, self._desk.snapshot(), Edit("robot.tool_frame", self._dropdown.value), self._answer)

    def show(self, snapshot: Snapshot) -> None:
        robot = snapshot.robot
        frames = robot.frames if robot.tool_frame in robot.frames else (*robot.frames, robot.tool_frame)
        if self._dropdown.options != frames:
            self._dropdown.options = frames
        if not self._answer.awaited(snapshot):
            self._dropdown.value = robot.tool_frame


class ArmVerdict:
    """Badge that says whether the true arm is inside the declared set, and if not, which inequality is violated."""

    def __init__(self, desk: Desk) -> None:
        self._html = desk.gui.add_html("")

    def show(self, snapshot: Snapshot) -> None:
        violated = snapshot.standing.outsiders
        word, look = ("outside", "vs-bad") if violated else ("inside", "vs-good")
        badge = chip(f"true arm {word} the declared set", look)
        lines = "".join(f'<div class="vs-message vs-bad">{escape(violation)}</div>' for violation in violated)
        self._html.content = f'<div class="vs-verdict">{badge} {_drives(snapshot)}{lines}</div>'


def _drives(snapshot: Snapshot) -> str:
    """Note on the drives' limits, which the declared bounds do not cover, as text."""
    limits = np.broadcast_to(snapshot.system.plant.truth.torque_limit, snapshot.robot.n)
    if not np.isfinite(limits).any():
        return '<div class="vs-note">the drives have no limit</div>'
    text = listed([f"{limit:.3g}" for limit in limits], "N·m", snapshot.robot.slides)
    note = f'<div class="vs-note">at most {text}, whatever the law asks for</div>'
    return f"{chip('drives limited', 'vs-warn')}{note}"
