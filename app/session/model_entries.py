"""Changes of the target model by entries on its diagonals, or by omega and zeta of coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from app.scenario.data import with_values
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.simulation.builders.controller_builder import matrices_of, mode_of, stiffness_met
from app.simulation.builders.environment_builder import robot_of
from controllers.second_order import oscillators, shaped

SWING = ("omega", "zeta")
# matrices whose entries follow from each name: on a pressed coordinate omega changes K_f, else K_m
CHANGED_BY = {"omega": ("B_m", "K_m", "K_f"), "zeta": ("B_m",)}


def diagonal_or_rows(matrix: np.ndarray) -> list[Any]:
    """Numbers of a matrix as a scenario holds them: the n entries of a diagonal matrix, else n rows."""
    diagonal = np.diag(matrix)
    return (matrix if np.count_nonzero(matrix - np.diag(diagonal)) else diagonal).tolist()


def pressed_on(scenario: Scenario, n: int) -> np.ndarray:
    """Stiffness (n,) N/m that the controller assumes each of n coordinates to press on while the others are held, see
    `Mode.environment`."""
    return np.diag(mode_of(scenario).environment(n, stiffness_met(scenario)))


def with_model_entries(scenario: Scenario, entries: Mapping[str, Mapping[int, float]]) -> Scenario:
    """The scenario with other entries on the diagonals of its target model, see `EditModel`; a matrix at the mode's
    default is written out where it changes. Raises ScenarioError and RobotError."""
    before = matrices_of(scenario, robot_of(scenario).n)
    after = {name: matrix.copy() for name, matrix in before.items()}
    for name in entries.keys() - {*SWING}:
        diagonal = list(entries[name])
        after[name][diagonal, diagonal] = list(entries[name].values())
    if entries.keys() & {*SWING}:
        _swing(scenario, after, {name: entries.get(name, {}) for name in SWING})
    changed = {name for name in before if not np.array_equal(after[name], before[name])}
    return with_values(scenario, {f"target_model.{name}": diagonal_or_rows(after[name]) for name in changed})


def _swing(scenario: Scenario, matrices: dict[str, np.ndarray], wanted: Mapping[str, Mapping[int, float]]) -> None:
    """Give coordinates their omega and zeta by entries of B_m, K_m and K_f; one that is not wanted stays.
    wanted: by name, then by coordinate. Raises ScenarioError where a coordinate has no such value that could stay."""
    n = len(matrices["M_m"])
    K_e = pressed_on(scenario, n)
    now = oscillators(**matrices, K_e=K_e)
    for i in sorted(wanted["omega"].keys() | wanted["zeta"].keys()):
        omega, zeta = (float(wanted[name].get(i, getattr(now, name)[i])) for name in SWING)
        if not np.isfinite([omega, zeta]).all():
            raise ScenarioError(
                f"target_model: coordinate {i + 1} does not swing; allowed: omega and zeta where M_m and "
                "K_m + K_f K_e are above 0"
            )
        M_m, K_m, K_f = (float(matrices[name][i, i]) for name in ("M_m", "K_m", "K_f"))
        entries = shaped(M_m, K_m, K_f, float(K_e[i]), omega, zeta)
        matrices["B_m"][i, i] = entries.B_m
        if i in wanted["omega"]:  # else they stay as they are, without rounding
            matrices["K_m"][i, i], matrices["K_f"][i, i] = entries.K_m, entries.K_f
