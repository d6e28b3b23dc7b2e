"""The target model (8) with its numbers, one equation per task coordinate, as MathML."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

from app.runner import Snapshot

_NAMES = ("M_m", "B_m", "K_m", "K_f")
_GREEK = {"phi": "φ", "psi": "ψ", "lambda": "λ", "alpha": "α", "beta": "β", "gamma": "γ", "theta": "θ"}


def symbol(coordinate: str) -> str:
    """A coordinate's name as plain text: "psi_1" is ψ₁."""
    stem, _, index = coordinate.partition("_")
    return _GREEK.get(stem, stem) + index.translate(str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉"))


def equation_html(snapshot: Snapshot) -> str:
    """(8), then every row with its numbers; the entries that the mode fixes are grey."""
    model = snapshot.scenario.target_model
    matrices = {name: getattr(model, name) for name in _NAMES}
    rows = [_general()]
    if all(matrix is not None for matrix in matrices.values()):
        rows += [_row(i, matrices, snapshot) for i in range(len(snapshot.coordinates))]
    return (
        '<div class="vs-equation"><math display="block"><mtable columnalign="right right right left left" '
        f'columnspacing="0.35em" rowspacing="0.32em">{"".join(rows)}</mtable></math></div>'
    )


def _general() -> str:
    error, force = "<msub><mi>e</mi><mi>r</mi></msub>", "<msub><mi>e</mi><msub><mi>F</mi><mi>c</mi></msub></msub>"
    return _cells(
        [
            f"{_sub('M', 'm')}{_dots(error, '¨')}",
            f"<mo>+</mo>{_sub('B', 'm')}{_dots(error, '˙')}",
            f"<mo>+</mo>{_sub('K', 'm')}{error}",
            f"<mo>=</mo><mo>−</mo>{_sub('K', 'f')}{force}",
            '<mspace width="0.6em"/><mtext mathcolor="#888">(8)</mtext>',
        ]
    )


def _row(i: int, matrices: dict[str, Any], snapshot: Snapshot) -> str:
    name, _ = snapshot.coordinates[i]
    error = f"<msub><mi>e</mi><mi>{escape(symbol(name))}</mi></msub>"
    force = f"<msub><mi>e</mi><mrow><mi>F</mi><mi>{escape(symbol(name))}</mi></mrow></msub>"
    factors = (_dots(error, "¨"), _dots(error, "˙"), error, force)
    terms = [
        _term(matrices[key], i, factor, fixed=is_fixed(snapshot, key, i))
        for key, factor in zip(_NAMES, factors, strict=True)
    ]
    coupled = any(_coupled(matrices[key], i) for key in _NAMES)
    return _cells(
        [
            terms[0],
            f"<mo>+</mo>{terms[1]}",
            f"<mo>+</mo>{terms[2]}",
            f"<mo>=</mo><mo>−</mo>{terms[3]}",
            '<mtext mathcolor="#888">+ coupling</mtext>' if coupled else "",
        ]
    )


def _term(matrix: Any, i: int, factor: str, *, fixed: bool) -> str:
    grey = ' class="fixed"' if fixed else ""
    return f"<mrow{grey}><mn>{entry(matrix, i):.4g}</mn><mspace width='0.15em'/>{factor}</mrow>"


def entry(matrix: Any, i: int) -> float:
    """Diagonal entry i of a matrix given by its diagonal or by its rows."""
    row = matrix[i]
    return float(row[i] if isinstance(row, tuple | list) else row)


def _coupled(matrix: Any, i: int) -> bool:
    row = matrix[i]
    return isinstance(row, tuple | list) and any(value for j, value in enumerate(row) if j != i)


def is_fixed(snapshot: Snapshot, name: str, i: int) -> bool:
    """Whether the mode fixes diagonal entry i of this matrix."""
    mask = np.asarray(snapshot.fixed.get(name, False))
    return bool(mask[i, i] if mask.ndim == 2 else mask)


def _cells(contents: list[str]) -> str:
    return "<mtr>" + "".join(f"<mtd>{content}</mtd>" for content in contents) + "</mtr>"


def _sub(base: str, index: str) -> str:
    return f"<msub><mi>{base}</mi><mi>{index}</mi></msub>"


def _dots(base: str, accent: str) -> str:
    return f'<mover accent="true">{base}<mo>{accent}</mo></mover>'
