"""Equation of the target model (8) with its numbers, as MathML: one line for coordinates with the same numbers,
matrices where coordinates are coupled."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

import numpy as np
from scipy.sparse.csgraph import connected_components

from app.scenario.number_text import short
from app.session.snapshot import Snapshot

_NAMES = ("M_m", "B_m", "K_m", "K_f")
_LETTERS = {"": "e", "˙": "ė", "¨": "ë"}
_INLINE = 3  # rows of the largest matrix within the equation; a larger one is written below it


@dataclass(frozen=True)
class EquationLine:
    """Line of the equation: the coordinates, from 0, that it is written for. They are coupled with one another, or
    uncoupled with equal numbers."""

    indices: tuple[int, ...]
    coupled: bool


def lines(snapshot: Snapshot) -> list[EquationLine]:
    """Lines of the equation, as few as show every number of the model."""
    matrices = [snapshot.matrices[name] for name in _NAMES]
    links = sum((matrix != 0.0).astype(int) for matrix in matrices)
    _, labels = connected_components(links, directed=False)
    parts: dict[int, list[int]] = {}
    for i, label in enumerate(labels):
        parts.setdefault(label, []).append(i)
    found: list[EquationLine] = []
    for indices in parts.values():
        part = tuple(indices)
        alike = next((k for k, line in enumerate(found) if _same(line, part, snapshot)), None)
        if alike is None:
            found.append(EquationLine(part, coupled=len(part) > 1))
        else:
            found[alike] = EquationLine((*found[alike].indices, *part), coupled=False)
    return found


def _same(line: EquationLine, part: tuple[int, ...], snapshot: Snapshot) -> bool:
    """Whether an uncoupled coordinate has the same numbers as a line of uncoupled ones, and the mode fixes the same."""
    if line.coupled or len(part) != 1:
        return False
    i, j = line.indices[0], part[0]
    return all(
        snapshot.matrices[name][i, i] == snapshot.matrices[name][j, j]
        and is_fixed(snapshot, name, i) == is_fixed(snapshot, name, j)
        for name in _NAMES
    )


def equation_html(snapshot: Snapshot) -> str:
    """Description of the mode, (8) in symbols, and its lines with numbers; the entries that the mode fixes are grey."""
    mode = snapshot.system.mode
    units = ", ".join(f"{name} in {unit}" for name, unit in snapshot.system.units.of_model.items() if unit)
    about = f"{mode.title} {mode.equation}: {mode_summary(snapshot)} {units}. Grey numbers are fixed by the mode."
    rows = [_general(), *(_row(line, snapshot) for line in lines(snapshot))]
    return (
        '<div class="vs-equation"><div class="vs-row vs-about" tabindex="0">'
        f'<span>{escape(mode.title)} <span class="vs-dim">{escape(mode.equation)}</span></span>'
        f'<span class="vs-ask vs-right">?</span><span class="vs-tip">{escape(about)}</span></div>'
        '<math display="block"><mtable columnalign="left right right right left" '
        f'columnspacing="0.3em" rowspacing="0.35em">{"".join(rows)}</mtable></math>{_below(snapshot)}</div>'
    )


def mode_summary(snapshot: Snapshot) -> str:
    """Summary of the mode, and under a law other than the robust one, that nothing promises it."""
    summary, law = snapshot.system.mode.summary, snapshot.system.controller.law
    return summary if law.robust else f"{summary} The present law, {law.title}, does not guarantee this."


def _general() -> str:
    force = _explained("<mi>e</mi><msub><mi>F</mi><mi>c</mi></msub>", "e_F")
    return _cells(
        [
            '<mtext data-symbol="(8)" tabindex="0" class="vs-where">(8)</mtext>',
            f"{_matrix('M_m')}{_explained_error('¨')}",
            f"<mo>+</mo>{_matrix('B_m')}{_explained_error('˙')}",
            f"<mo>+</mo>{_matrix('K_m')}{_explained_error('')}",
            f"<mo>=</mo><mo>−</mo>{_matrix('K_f')}{force}",
        ]
    )


def _explained(content: str, symbol: str) -> str:
    """Letter with its index, marked so that the page's script explains it."""
    return f'<msub data-symbol="{symbol}" tabindex="0">{content}</msub>'


def _matrix(name: str) -> str:
    letter, index = name.split("_")
    return _explained(f"<mi>{letter}</mi><mi>{index}</mi>", name)


def _explained_error(accent: str) -> str:
    letter = _LETTERS[accent]
    return _explained(f'<mi style="font-style: italic">{letter}</mi><mi>r</mi>', f"{letter}_r")


def _row(line: EquationLine, snapshot: Snapshot) -> str:
    force = "<msub><mi>e</mi><mi>F</mi></msub>"
    factors = (_error("¨"), _error("˙"), _error(""), force)
    number = _block if line.coupled else _number
    terms = []
    for name, factor in zip(_NAMES, factors, strict=True):
        grey = all(is_fixed(snapshot, name, i) for i in line.indices)
        look = ' class="fixed"' if grey else ""
        if _large(line, snapshot.matrices[name]):
            value = _sub(*name.split("_"))
        else:
            value = number(snapshot.matrices[name], line.indices, snapshot.fixed[name])
        terms.append(f'<mrow{look}>{value}<mspace width="0.15em"/>{factor}</mrow>')
    return _cells(
        [
            _names(line, snapshot),
            terms[0],
            f"<mo>+</mo>{terms[1]}",
            f"<mo>+</mo>{terms[2]}",
            f"<mo>=</mo><mo>−</mo>{terms[3]}",
        ]
    )


def _below(snapshot: Snapshot) -> str:
    """Matrices that are too large for the equation."""
    shown = [
        f"<mrow>{_sub(*name.split('_'))}<mo>=</mo>{_block(snapshot.matrices[name], line.indices, snapshot.fixed[name])}"
        "</mrow>"
        for line in lines(snapshot)
        for name in _NAMES
        if _large(line, snapshot.matrices[name])
    ]
    return "".join(f'<math display="block">{matrix}</math>' for matrix in shown)


def _large(line: EquationLine, matrix: np.ndarray) -> bool:
    return line.coupled and len(line.indices) > _INLINE and not _scalar(matrix[np.ix_(line.indices, line.indices)])


def _scalar(matrix: np.ndarray) -> bool:
    """Whether a matrix is one number times the identity."""
    return bool((matrix == matrix[0, 0] * np.eye(len(matrix))).all())


def _names(line: EquationLine, snapshot: Snapshot) -> str:
    """Names of a line's coordinates, side by side, or below one another beside the rows of a matrix."""
    names = [escape(snapshot.coordinates[i].name) for i in line.indices]
    below = any(_large(line, matrix) for matrix in snapshot.matrices.values())
    if not line.coupled or below:
        return f'<mtext class="vs-where">{" ".join(names)}</mtext>'
    rows = "".join(f'<mtr><mtd><mtext class="vs-where">{name}</mtext></mtd></mtr>' for name in names)
    return f'<mtable rowspacing="0.1em">{rows}</mtable>'


def _number(matrix: np.ndarray, indices: tuple[int, ...], _: np.ndarray) -> str:
    return f"<mn>{short(matrix[indices[0], indices[0]], 4)}</mn>"


def _block(matrix: np.ndarray, indices: tuple[int, ...], fixed: np.ndarray) -> str:
    """Matrix of coupled coordinates, fixed entries grey; a number where it is one times the identity."""
    matrix, fixed = matrix[np.ix_(indices, indices)], fixed[np.ix_(indices, indices)]
    if _scalar(matrix):
        return _number(matrix, (0,), fixed)
    rows = "".join(
        "<mtr>" + "".join(_entry(value, grey=grey) for value, grey in zip(*row, strict=True)) + "</mtr>"
        for row in zip(matrix, fixed, strict=True)
    )
    # the brackets are the table's borders: not every machine has a font whose brackets grow
    return f'<mtable class="vs-block" columnspacing="0.35em" rowspacing="0.1em">{rows}</mtable>'


def _entry(value: float, *, grey: bool) -> str:
    look = ' class="fixed"' if grey else ""
    return f"<mtd{look}><mn>{short(value, 4) if value else '·'}</mn></mtd>"


def is_fixed(snapshot: Snapshot, name: str, i: int) -> bool:
    """Whether the mode fixes diagonal entry i of this matrix."""
    return name in snapshot.fixed and bool(snapshot.fixed[name][i, i])


def _cells(contents: list[str]) -> str:
    # each has a row of its own, so that it stays in one piece where a narrow page breaks the line between cells
    return "<mtr>" + "".join(f"<mtd><mrow>{content}</mrow></mtd>" for content in contents) + "</mtr>"


def _sub(base: str, index: str) -> str:
    return f"<msub><mi>{base}</mi><mi>{index}</mi></msub>"


def _error(accent: str) -> str:
    # composed letters, as a separate accent (<mover>) cannot be seen in small type
    return f'<mi style="font-style: italic">{_LETTERS[accent]}</mi>'
