"""Check of a path of the user's own (`--use`): finite, from the start on, with a rate and an acceleration that are its
derivatives."""

from __future__ import annotations

import numpy as np

from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.simulation.period.planned_reference import Planned
from environments.surfaces.regular import AGREEMENT, STEP
from environments.trajectories.own import OwnPath

INSTANTS = 40
AT_START = 1e-9  # m or rad


def require_path(scenario: Scenario, reference: Planned, start: np.ndarray) -> None:
    """Raise ScenarioError where a path of the user's own does not begin at the start, is not finite, or where
    differences of it are not its derivatives, at some instant of the run.

    start: (k,), the last k coordinates of r_d without the path.
    """
    own = [name for name in ("motion", "rotation") if isinstance(getattr(scenario, name), OwnPath)]
    if not own:
        return
    path, duration = f"{' or '.join(own)}.name", scenario.simulation.duration
    instants = np.sort(np.random.default_rng(0).uniform(STEP, max(duration, 2 * STEP), INSTANTS))
    # copies: the plan writes every answer into the same memory
    before, now, after = (
        np.array([np.array(reference.at(t)[:3]) for t in instants + shift]) for shift in (-STEP, 0.0, STEP)
    )
    finite = np.isfinite([before, now, after]).all(axis=(0, 2, 3))
    if not finite.all():
        raise ScenarioError(
            f"{path}: at t = {instants[~finite][0]:.3g} s the path is not finite; allowed: one that is finite for all "
            f"of the run, {duration:g} s (simulation.duration)"
        )
    first = np.abs(np.array(reference.at(0.0).r_d)[len(now[0, 0]) - len(start) :] - start).max(initial=0.0)
    if not first <= AT_START:
        raise ScenarioError(f"{path}: at t = 0 s the path is {first:.3g} away from the start; allowed: 0")
    for k, name in enumerate(("rate", "acceleration")):
        differences = (after[:, k] - before[:, k]) / (2 * STEP)
        away = np.abs(now[:, k + 1] - differences).max(axis=1)
        worst = int((away - AGREEMENT * np.abs(differences).max(axis=1)).argmax())
        if not away[worst] <= AGREEMENT * (1.0 + np.abs(differences[worst]).max()):
            raise ScenarioError(
                f"{path}: at t = {instants[worst]:.3g} s its {name} is not what differences say, by {away[worst]:.2g}; "
                "allowed: a path whose rate and acceleration are its derivatives"
            )
