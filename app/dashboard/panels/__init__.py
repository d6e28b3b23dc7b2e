"""The tabs of the control panel, one file each: they post commands and read snapshots, and hold no state of the run."""

from __future__ import annotations

from typing import ClassVar, Protocol

from app.dashboard.panels.controller import ControllerPanel
from app.dashboard.panels.export import ExportPanel
from app.dashboard.panels.lessons import LessonsPanel
from app.dashboard.panels.model import ModelPanel
from app.dashboard.panels.robot import RobotPanel
from app.dashboard.panels.robustness import RobustnessPanel
from app.dashboard.panels.runs import RunsPanel
from app.dashboard.panels.task import TaskPanel
from app.dashboard.panels.view import ViewPanel
from app.dashboard.panels.world import WorldPanel
from app.dashboard.widgets.fields.controls import Desk
from app.session.snapshot import Snapshot


class Panel(Protocol):
    """Panel: one tab of controls. It makes its widgets in the current container; `show` sets them to a snapshot.

    holds: what is in it, for the command palette."""

    holds: ClassVar[str]

    def __init__(self, desk: Desk) -> None: ...

    def show(self, snapshot: Snapshot) -> None: ...


PANELS: dict[str, type[Panel]] = {
    "Task": TaskPanel,
    "Model": ModelPanel,
    "Controller": ControllerPanel,
    "World": WorldPanel,
    "Robot": RobotPanel,
    "View": ViewPanel,
    "Runs": RunsPanel,
    "Robustness": RobustnessPanel,
    "Export": ExportPanel,
    "Lessons": LessonsPanel,
}
