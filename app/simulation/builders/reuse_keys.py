"""Reuse keys: the parts of a scenario that a part of its system is made of. Where an edit leaves a key equal, the
part is used again."""

from __future__ import annotations

import msgspec

from app.scenario.schema import Scenario
from controllers.modes import MODES


def plant_key(scenario: Scenario) -> tuple[object, ...]:
    """Parts of the scenario that the plant is made of, besides arm and surfaces."""
    rules, met = scenario.simulation, tuple((each.index, each.contact) for each in scenario.surfaces)
    return scenario.truth, met, scenario.face, scenario.coupling, rules.integrator, rules.substeps


def sampled_loops_key(scenario: Scenario) -> Scenario:
    """The part of the scenario on which a sampled loop depends: all but its names, and the desired forces where no
    surface is curved."""
    plain = msgspec.structs.replace(scenario, name="", title="")
    if not all(each.form.normal_fixed for each in scenario.surfaces):
        return plain
    usual = Scenario()
    second = msgspec.structs.replace(scenario.second, force=usual.second.force)
    third = msgspec.structs.replace(scenario.third, force=usual.third.force)
    return msgspec.structs.replace(plain, force=usual.force, second=second, third=third)


def surfaces_key(scenario: Scenario) -> tuple[object, ...]:
    """Parts of the scenario that its surfaces depend on, and where they are checked."""
    touched = tuple((each.form, each.contact.kind) for each in scenario.surfaces)
    return touched, scenario.robot, scenario.mode, scenario.simulation


def constants_key(scenario: Scenario) -> tuple[object, ...]:
    """Parts of the scenario that the constants over Omega depend on, besides the start."""
    return *omega_key(scenario), scenario.declared


def omega_key(scenario: Scenario) -> tuple[object, ...]:
    """Parts of the scenario that Omega depends on, besides the start."""
    names = ("robot", "task_space", "mode", "motion", "rotation", "shift", "simulation")
    where = (*(getattr(scenario, name) for name in names), scenario.face.flat, scenario.face.normal)
    where = (*where, *((each.form, each.pressed) for each in scenario.surfaces))
    if scenario.controller.estimates == "along-reference":
        return (
            *where,
            scenario.face,
            scenario.coupling.K_e_hat,
            *((each.force, each.K_e_hat, each.contact.unilateral) for each in scenario.surfaces),
        )
    return where


def controller_key(scenario: Scenario) -> tuple[object, ...]:
    """Fields that the controller is built from, without the true arm, the true contact and the reference."""
    known = (
        "robot",
        "mode",
        "task_space",
        "declared",
        "controller",
        "target_model",
        "second",
        "third",
        "coupling",
        "face",
    )
    met = scenario.contact if MODES[scenario.mode].feedback == "all" else scenario.contact.nature
    return *(getattr(scenario, name) for name in known), met, scenario.contact.unilateral
