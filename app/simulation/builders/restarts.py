"""Changes of a scenario that begin a new run, and those that a running one takes up."""

from __future__ import annotations

from app.scenario.schema import Scenario

# sections of which every change begins a new run
RESTARTING = ("mode", "robot", "task_space", "simulation")


def begins_anew(old: Scenario, new: Scenario) -> bool:
    """Whether a change of the scenario begins a new run by what it changes; a blend in the past and a run that has
    stopped do so, too (`ClosedLoop.edit`)."""
    return any(getattr(old, field) != getattr(new, field) for field in RESTARTING) or _start(old) != _start(new)


def _start(scenario: Scenario) -> tuple[object, ...]:
    """Fields, besides the sections in `RESTARTING`, that a run begins with."""
    surfaces = tuple((each.path, each.form, each.contact.kind, each.pressed) for each in scenario.surfaces)
    face = scenario.face.flat, scenario.face.normal
    return surfaces, face, scenario.controller.period, scenario.controller.z_0


def meets_another_load(old: Scenario, new: Scenario) -> bool:
    """Whether an arm that touches something bears another load after this change of the contact."""
    return _contact(old) != _contact(new)


def _contact(scenario: Scenario) -> tuple[object, ...]:
    """Parts of a scenario that the load depends on, besides arm and surfaces."""
    return [each.contact for each in scenario.surfaces], scenario.coupling, scenario.face
