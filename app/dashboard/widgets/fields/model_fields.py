"""Places of the target model that can be edited: entries on a diagonal, omega or zeta of a coordinate, whole matrices
at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from msgspec import to_builtins

from app.dashboard.widgets.fields.field_binding import FieldBinding
from app.dashboard.widgets.fields.matrix_text import written
from app.dashboard.widgets.target_model.equation import is_fixed
from app.scenario.units import Units
from app.session.commands import Blend, Edit, EditAll, EditModel
from app.session.model_entries import diagonal_or_rows, pressed_on
from app.session.snapshot import Snapshot
from controllers.second_order import Oscillators, oscillators


def model_edit(snapshot: Snapshot, matrices: Mapping[str, np.ndarray]) -> Edit:
    """Edit to the model that these matrices and the others of the snapshot make, to judge it or to blend to it."""
    given = {name: value for name, value in to_builtins(snapshot.scenario.target_model).items() if value is not None}
    return Edit("target_model", given | {name: diagonal_or_rows(matrix) for name, matrix in matrices.items()})


def only(matrices: Mapping[str, np.ndarray]) -> EditAll:
    """Command that sets these matrices together at once; others stay, also those that were changed a moment before."""
    return EditAll({f"target_model.{name}": diagonal_or_rows(matrix) for name, matrix in matrices.items()})


def blending(edit: Edit, over: float) -> Blend:
    """Command that blends to the model of a `model_edit` over that many s."""
    return Blend(edit.value, over)  # pyright: ignore[reportArgumentType]


def oscillators_of(snapshot: Snapshot) -> Oscillators:
    """omega and zeta of every coordinate of the running model."""
    return oscillators(**snapshot.matrices, K_e=pressed_on(snapshot.scenario, len(snapshot.coordinates)))


def alone() -> bool:
    """Answer of a number that is not linked to others: False."""
    return False


def alike(snapshot: Snapshot, index: int, values: np.ndarray) -> list[int]:
    """Numbers of the coordinates that are linked to one, itself included: those of its kind, length or angle, with the
    same value. index: of the coordinate. values: (n,)."""
    of = [coordinate.is_angle for coordinate in snapshot.coordinates]
    equal = np.isclose(values, values[index], rtol=1e-9)
    return [j for j in range(len(of)) if of[j] == of[index] and equal[j]]


@dataclass(frozen=True)
class DiagonalBinding(FieldBinding):
    """Binding of entry `index` on the diagonal of a matrix of the target model in force.
    linked: whether an edit also sets the equal entries of like coordinates that the mode leaves free."""

    index: int
    linked: Callable[[], bool] = alone

    def read(self, snapshot: Snapshot) -> Any:
        matrix = self._matrix(snapshot)
        return float(matrix[self.index, self.index]) if self.index < len(matrix) else None

    def edit(self, snapshot: Snapshot, value: Any) -> EditModel:
        return EditModel({self._name: dict.fromkeys(self._set(snapshot), _single(value))})

    def moved(self, snapshot: Snapshot) -> tuple[FieldBinding, ...]:
        return tuple(replace(self, index=i) for i in self._set(snapshot))

    def _set(self, snapshot: Snapshot) -> list[int]:
        """Coordinates that an edit sets."""
        indices = alike(snapshot, self.index, np.diag(self._matrix(snapshot))) if self.linked() else [self.index]
        return [i for i in indices if i == self.index or not is_fixed(snapshot, self._name, i)]

    def entry(self, snapshot: Snapshot) -> tuple[str, Mapping[str, Any]]:
        matrix, place = diagonal_or_rows(self._matrix(snapshot)), str(self.index + 1)
        path = f"{self.path}.{place}.{place}" if isinstance(matrix[0], list) else f"{self.path}.{place}"
        return path, {self.path: matrix}

    @property
    def _name(self) -> str:
        return self.path.rpartition(".")[2]

    def _matrix(self, snapshot: Snapshot) -> np.ndarray:
        return snapshot.matrices[self._name]


@dataclass(frozen=True)
class OscillatorBinding(FieldBinding):
    """Binding of omega or zeta of coordinate `index`; an edit keeps M_m and the other of the two. See
    `controllers.second_order`.
    linked: whether an edit also sets like coordinates with the same value."""

    kind: Literal["omega", "zeta"]
    index: int
    linked: Callable[[], bool] = alone

    def read(self, snapshot: Snapshot) -> Any:
        values = getattr(oscillators_of(snapshot), self.kind)
        if self.index >= len(values) or not np.isfinite(values[self.index]):
            return None
        return float(values[self.index])

    def edit(self, snapshot: Snapshot, value: Any) -> EditModel:
        number = _single(value)
        if not number > 0.0:
            raise ValueError(f"{written(number)}; allowed: a number > 0")
        return EditModel({self.kind: dict.fromkeys(self._set(snapshot), number)})

    def moved(self, snapshot: Snapshot) -> tuple[FieldBinding, ...]:
        return tuple(replace(self, index=i) for i in self._set(snapshot))

    def _set(self, snapshot: Snapshot) -> list[int]:
        """Coordinates that an edit sets."""
        if not self.linked():
            return [self.index]
        return alike(snapshot, self.index, getattr(oscillators_of(snapshot), self.kind))

    def entry(self, snapshot: Snapshot) -> tuple[str, Mapping[str, Any]]:
        del snapshot
        raise ValueError("it follows from several matrices; allowed: an entry of M_m, B_m, K_m or K_f")

    def hint_in(self, units: Units) -> str:
        del units
        return {
            "omega": "natural frequency: ω² = (K_m + K_f K̂_e) / M_m [rad/s] > 0",
            "zeta": "damping ratio: 2 ζ ω = B_m / M_m > 0; 1 is critical",
        }[self.kind]


def _single(value: Any) -> float:
    if isinstance(value, list):
        raise ValueError(f"{written(value)!r:.60}; allowed: a single number")
    return float(value)
