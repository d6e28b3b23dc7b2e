"""Editor of whole matrices of the target model: a draft in 3 x 3 blocks or as pasted text, judged and applied
together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape

import numpy as np
import viser

from app.dashboard.transport.page_values import PageEvent, from_pages
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.fields.matrix_text import read_matrix, written_rows
from app.dashboard.widgets.fields.model_fields import blending, model_edit, only
from app.dashboard.widgets.target_model.model_checks import blend_html
from app.session.commands import Edit
from app.session.snapshot import Snapshot

NAMES: tuple[str, ...] = ("M_m", "B_m", "K_m", "K_f")
_NO_BLOCKS: tuple[str, ...] = ("",)


@dataclass(frozen=True)
class Draft:
    """Draft of n x n matrices: their texts by name, which the user has typed and not applied yet."""

    n: int
    texts: Mapping[str, str] = field(default_factory=dict)

    def with_text(self, name: str, text: str) -> Draft:
        """The draft with another text of this matrix."""
        return Draft(self.n, {**self.texts, name: text})

    def matrix(self, name: str) -> np.ndarray:
        """Matrix (n, n) of the draft. Raises ValueError, naming the matrix, for a text that cannot be read."""
        try:
            return read_matrix(self.texts[name], self.n)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error

    def matrices(self) -> dict[str, np.ndarray]:
        """All matrices of the draft. Raises ValueError as `matrix` does."""
        return {name: self.matrix(name) for name in self.texts}


def with_entries(matrix: np.ndarray, rows: int, columns: int, block: np.ndarray) -> np.ndarray:
    """The matrix (n, n) with the changed entries of the block at (rows, columns) set, and their mirror images."""
    changed = matrix.copy()
    for i, j in np.argwhere(block != matrix[rows : rows + len(block), columns : columns + len(block)]):
        changed[rows + i, columns + j] = changed[columns + j, rows + i] = block[i, j]
    return changed


def starts(n: int) -> list[int]:
    """First indices of the blocks of three that cover n coordinates; the last two blocks may overlap."""
    return sorted({min(start, max(n - 3, 0)) for start in range(0, n, 3)})


def unit_of_entries(snapshot: Snapshot, name: str) -> str:
    """Unit of the entries of this matrix in words."""
    unit = snapshot.system.units.of_model[name]
    if not unit:
        return "entries without unit"
    scaled = any(coordinate.metres_per_radian is not None for coordinate in snapshot.coordinates)
    return f"all entries in {unit}" + (", also those of angles, which r holds times ℓ" if scaled else "")


class MatrixEditor:
    """Editor of the draft in the current container. The draft is state of the page; `edit` returns what its model is
    judged by. A draft of a matrix that something else has changed meanwhile, such as a way out, is dropped."""

    def __init__(self, desk: Desk) -> None:
        self._desk, gui = desk, desk.gui
        self._draft = Draft(0)
        self._running: dict[str, np.ndarray] = {}  # matrices in force of which there is a draft
        self._answers: tuple[int, int] | None = None  # counts of the runner's answers when the draft was sent
        self._name, self._block = "K_m", 0
        self._matrix = gui.add_dropdown("Matrix", NAMES, initial_value=self._name)
        self._matrix.on_update(from_pages(self._on_choice))
        self._unit = gui.add_html("")
        self._blocks = gui.add_dropdown("Block", _NO_BLOCKS, hint="Rows × columns. The mirrored entry changes, too.")
        self._blocks.on_update(from_pages(self._on_choice))
        self._rows: dict[int, list[viser.GuiVector2Handle] | list[viser.GuiVector3Handle]] = {
            2: [gui.add_vector2("", (0.0, 0.0), step=1.0, visible=False) for _ in range(2)],
            3: [gui.add_vector3("", (0.0, 0.0, 0.0), step=1.0) for _ in range(3)],
        }
        for row in (*self._rows[2], *self._rows[3]):
            row.precision = 4
            row.on_update(from_pages(self._on_row))
        self._text = gui.add_text(
            "or paste", "", multiline=True, hint="n rows of n numbers, or n numbers for a diagonal; blanks or commas."
        )
        self._text.on_update(from_pages(self._on_text))
        self._over = gui.add_number(
            "blend over [s]",
            0.0,
            min=0.0,
            max=3600.0,
            step=0.5,
            hint="0: at once. Otherwise a convex blend, if it is stable.",
        )
        self._over.precision = 3
        self._over.on_update(from_pages(self._on_over))
        self._seconds = 0.0
        self._blend_note: tuple[object, str] | None = None
        self._buttons = gui.add_button_group("", ("apply all", "discard"))
        self._buttons.on_click(self._on_button)
        self._note = gui.add_html("")

    def edit(self, snapshot: Snapshot) -> Edit | None:
        """Edit to the draft's model, None without a draft. Raises ValueError for a text that is no matrix."""
        return model_edit(snapshot, self._draft.matrices()) if self._draft.texts else None

    async def _on_choice(self, _: PageEvent) -> None:
        self._name = self._matrix.value
        if self._blocks.value in self._blocks.options:
            self._block = self._blocks.options.index(self._blocks.value)
        self.show(self._desk.snapshot())

    async def _on_row(self, _: PageEvent) -> None:
        snapshot = self._desk.snapshot()
        rows, columns, width = self._window(len(snapshot.coordinates))
        block = np.array([row.value for row in self._rows[width]])
        changed = with_entries(self._current(snapshot), rows, columns, block)
        self._draft = self._draft.with_text(self._name, written_rows(changed))

    async def _on_text(self, _: PageEvent) -> None:
        self._draft = self._draft.with_text(self._name, self._text.value)

    async def _on_over(self, _: PageEvent) -> None:
        self._seconds = float(self._over.value)

    async def _on_button(self, event: viser.GuiEvent) -> None:
        if event.target.value == "discard":
            self._draft = Draft(self._draft.n)
            return
        snapshot = self._desk.snapshot()
        try:
            edit = self.edit(snapshot)
        except ValueError as error:
            self._desk.complain(str(error))
            return
        if edit is not None:
            command = blending(edit, self._seconds) if self._seconds else only(self._draft.matrices())
            refused = self._desk.post(command) is None
            self._answers = None if refused else (snapshot.revision, snapshot.refusal_number)

    def show(self, snapshot: Snapshot) -> None:
        n = len(snapshot.coordinates)
        running = {name: snapshot.matrices[name] for name in self._draft.texts} if self._draft.n == n else {}
        replaced = any(not np.array_equal(self._running.get(name, matrix), matrix) for name, matrix in running.items())
        self._running = running
        if self._draft.n != n or self._accepted(snapshot) or (replaced and snapshot.blending is None):
            self._draft, self._running = Draft(n), {}
        self._matrix.value = self._name
        self._unit.content = f'<div class="vs-note">{unit_of_entries(snapshot, self._name)}</div>'
        self._show_blocks([coordinate.name for coordinate in snapshot.coordinates])
        matrix = self._current(snapshot)
        rows, columns, width = self._window(n)
        for i, row in enumerate(self._rows[width]):
            row.label = snapshot.coordinates[rows + i].name
            row.value = tuple(matrix[rows + i, columns : columns + width])
        self._text.value = self._draft.texts.get(self._name, written_rows(matrix))
        self._over.value = self._seconds
        self._note.content = self._pending() + self._blend(snapshot)

    def _pending(self) -> str:
        if not self._draft.texts:
            return ""
        try:
            sentence = f"{', '.join(self._draft.matrices())}: not applied yet."
        except ValueError as error:
            sentence = str(error)
        return f'<div class="vs-checks"><div class="vs-message vs-warn">{escape(sentence)}</div></div>'

    def _blend(self, snapshot: Snapshot) -> str:
        """Note on the blend to the draft, as HTML. Kept until the draft changes, since eigenvalues take long."""
        key = (snapshot.scenario, snapshot.blending, self._draft, self._seconds)
        if self._blend_note is None or self._blend_note[0] != key:
            try:
                edit = self.edit(snapshot) if self._seconds else None
            except ValueError:  # `_pending` shows it
                edit = None
            self._blend_note = (key, blend_html(snapshot, edit))
        return self._blend_note[1]

    def _accepted(self, snapshot: Snapshot) -> bool:
        """Whether the draft has been sent and accepted; a refused draft stays, to be corrected."""
        if self._answers is None or self._answers == (snapshot.revision, snapshot.refusal_number):
            return False
        accepted = snapshot.refusal_number == self._answers[1]
        self._answers = None
        return accepted

    def _show_blocks(self, names: list[str]) -> None:
        first = starts(len(names))
        options = tuple(f"{' '.join(names[i : i + 3])}  ×  {' '.join(names[j : j + 3])}" for i in first for j in first)
        if self._blocks.options != options:
            self._block = 0
            self._blocks.options = options
        self._blocks.value = options[self._block]
        if self._blocks.visible != (len(options) > 1):
            self._blocks.visible = len(options) > 1
        for width, rows in self._rows.items():
            for row in rows:
                if row.visible != (width == min(len(names), 3)):
                    row.visible = width == min(len(names), 3)

    def _window(self, n: int) -> tuple[int, int, int]:
        """First row, first column and width of the block on the screen."""
        first = starts(n)
        return first[self._block // len(first)], first[self._block % len(first)], min(n, 3)

    def _current(self, snapshot: Snapshot) -> np.ndarray:
        """Matrix (n, n) on the screen: that of the draft where it can be read, else the running one."""
        try:
            return self._draft.matrix(self._name)
        except (KeyError, ValueError):
            return snapshot.matrices[self._name]
