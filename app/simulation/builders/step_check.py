"""Check of the plant's step: contacts and frictions that it cannot follow are refused before anything runs."""

from __future__ import annotations

from app.scenario.errors import TooStiff
from app.scenario.field_info import field_info
from app.scenario.schema import Scenario
from environments.plant import Plant
from environments.step_resolution import Mobility, StiffElement, resolved, stiff_elements, substeps_needed

EASE = 1.5  # factor on the period for which substeps are proposed, so that with those the plant also settles


def require_resolved(scenario: Scenario, plant: Plant, mobility: Mobility) -> None:
    """Refuse contacts and frictions that the plant's step cannot follow where the arm is most mobile: the plant would
    explode whatever the controller does."""
    integrator, period = scenario.simulation.integrator, scenario.controller.period
    for o in unresolved(scenario, plant, mobility):
        enough = substeps_needed(integrator, o, EASE * period, int(field_info("simulation.substeps").largest or 1))
        raise TooStiff(
            f"{o.field}: {o.value:g} {o.unit} is too stiff for {plant.substeps} step(s) of {integrator} per control "
            f"period of {period:g} s, the simulation would diverge; allowed: "
            + ("" if enough is None else f"simulation.substeps >= {enough}, or ")
            + "a smaller value",
            enough,
        )


def unresolved(scenario: Scenario, plant: Plant, mobility: Mobility) -> list[StiffElement]:
    """Stiff elements of the plant that its step does not follow."""
    step = scenario.controller.period / plant.substeps
    K_t = scenario.face.K_t if scenario.face.flat else 0.0
    parts = (plant.nature, plant.contacts, plant.environment, plant.truth)
    paths = [each.path for each in scenario.surfaces]
    known = stiff_elements(*parts, mobility, K_t, plant.model.nv, paths)
    return [each for each in known if not resolved(scenario.simulation.integrator, each, step)]
