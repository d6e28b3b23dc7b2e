"""Way out of a refused target model: its symmetric part, or a part of the way to it from the model that runs."""

from __future__ import annotations

import msgspec
import numpy as np

from app.scenario.data import edited
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.model_entries import diagonal_or_rows
from app.session.ways_out import WayOut
from app.simulation.builders.controller_builder import matrices_of, require_admitted, surfaces_met
from app.simulation.system import System
from controllers.target_model import InvalidGain, TargetModel

_HALVINGS = 20  # of the interval in which the first refused model lies
_MARGIN = 0.8  # of the way to the first refused model, where a pole reaches the imaginary axis or a mass vanishes
_LEAST = 0.01  # least share of the way to the asked model that is offered


def way_to_model(running: System, requested: Scenario) -> WayOut | None:
    """Way out where a scenario is refused for its target model; None where another field was changed as well, and where
    the straight way from the running model is refused from its beginning."""
    scenario, mode, layout = running.scenario, running.mode, running.layout
    if scenario.blend.planned or requested.target_model == scenario.target_model:
        return None
    if msgspec.structs.replace(requested, target_model=scenario.target_model) != scenario:
        return None
    try:
        start, given = (matrices_of(each, layout.n) for each in (scenario, requested))
    except ScenarioError:
        return None
    if not all(np.isfinite(matrix).all() for matrix in given.values()):
        return None
    end = {name: 0.5 * (matrix + matrix.T) for name, matrix in given.items()}
    surfaces = surfaces_met(scenario, mode, layout)

    def allowed(fraction: float) -> bool:
        try:
            require_admitted(TargetModel(**_between(start, end, fraction)), scenario, mode, surfaces)
        except InvalidGain:
            return False
        return True

    if allowed(1.0):
        return WayOut("Take its symmetric part", _with(requested, start, end))
    good, bad = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if allowed(middle) else (good, middle)
    fraction = round(_MARGIN * good, 2)
    if fraction < _LEAST or not allowed(fraction):
        return None
    return WayOut(
        f"Go {100 * fraction:.0f} % of the way to it", _with(requested, start, _between(start, end, fraction))
    )


def _between(start: dict[str, np.ndarray], end: dict[str, np.ndarray], fraction: float) -> dict[str, np.ndarray]:
    return {name: (1.0 - fraction) * start[name] + fraction * end[name] for name in start}


def _with(scenario: Scenario, start: dict[str, np.ndarray], model: dict[str, np.ndarray]) -> Scenario:
    """The scenario with the matrices (n, n) of a model that differ from those at the start."""
    for name, matrix in model.items():
        if not np.array_equal(matrix, start[name]):
            scenario = edited(scenario, f"target_model.{name}", diagonal_or_rows(matrix))
    return scenario
