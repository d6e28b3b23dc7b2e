"""Edits of a single field: the scenario that each leads to, in which what cannot stay as it is fits the new value."""

from __future__ import annotations

from dataclasses import dataclass

from app.scenario.data import edited
from app.scenario.schema import Scenario
from app.session import changes
from app.session.commands import Edit


@dataclass(frozen=True)
class PlannedEdit:
    """Edit to a scenario.
    scenario: with all that changes.
    requested: what was asked for; what else has changed in the scenario that runs is then said. None where nothing is.
    nearest: whether the nearest scenario that can run may take its place."""

    scenario: Scenario
    requested: Scenario | None = None
    nearest: bool = False


def planned_edit(edit: Edit, now: Scenario) -> PlannedEdit | None:
    """Scenario that an edit leads to from the present one, None where it leaves it as it is. Raises ScenarioError."""
    match edit:
        case Edit("mode", value) if value == now.mode:
            return None  # the present mode is not begun anew
        case Edit("mode", value):
            return PlannedEdit(changes.in_mode(now, str(value)), requested=now, nearest=True)
        case Edit(path, value) if path.startswith("robot."):
            changed = changes.with_robot(now, {path.removeprefix("robot."): value})
            return PlannedEdit(changed, requested=now, nearest=True)
        case Edit("task_space.kind" | "task_space.supplemental" as path, value):
            requested = edited(now, path, value)
            changed = changes.in_coordinates(now, path.removeprefix("task_space."), value)
            return PlannedEdit(changed, requested, nearest=True)
        case Edit("surface" | "second.surface" | "third.surface" as path, str() as kind):
            changed = changes.on_surface(now, kind, path)
            return PlannedEdit(changed, requested=changed, nearest=True)
        case Edit("second.contact.kind" | "third.contact.kind" as path, str() as kind):
            requested = edited(now, path, kind)
            return PlannedEdit(changes.with_further(now, path.split(".")[0], kind), requested, nearest=True)
        case Edit("face.flat", bool() as flat):
            requested = edited(now, "face.flat", flat)
            return PlannedEdit(changes.with_face(now, flat=flat), requested, nearest=True)
        case Edit("second.control" | "third.control" as path, value):
            requested = edited(now, path, value)
            return PlannedEdit(changes.with_control(now, path, value), requested)
        case Edit(path, value):
            return PlannedEdit(edited(now, path, value))
