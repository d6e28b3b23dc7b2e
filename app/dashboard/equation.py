"""The target model (8) with its numbers, one equation per task coordinate, as MathML."""

from __future__ import annotations

from html import escape

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
    rows = [_general(), *(_row(i, snapshot) for i in range(len(snapshot.coordinates)))]
    return (
        '<div class="vs-equation"><math display="block"><mtable columnalign="right right right left left" '
        f'columnspacing="0.35em" rowspacing="0.32em">{"".join(rows)}</mtable></math></div>'
    )


def _general() -> str:
    force = "<msub><mi>e</mi><msub><mi>F</mi><mi>c</mi></msub></msub>"
    return _cells(
        [
            f"{_sub('M', 'm')}{_error('r', '¨')}",
            f"<mo>+</mo>{_sub('B', 'm')}{_error('r', '˙')}",
            f"<mo>+</mo>{_sub('K', 'm')}{_error('r')}",
            f"<mo>=</mo><mo>−</mo>{_sub('K', 'f')}{force}",
            '<mspace width="0.6em"/><mtext mathcolor="#888">(8)</mtext>',
        ]
    )


def _row(i: int, snapshot: Snapshot) -> str:
    index = escape(symbol(snapshot.coordinates[i].name))
    force = f"<msub><mi>e</mi><mrow><mi>F</mi><mi>{index}</mi></mrow></msub>"
    factors = (_error(index, "¨"), _error(index, "˙"), _error(index), force)
    terms = [_term(name, i, factor, snapshot) for name, factor in zip(_NAMES, factors, strict=True)]
    coupled = any(np.count_nonzero(snapshot.matrices[name][i]) > (entry != 0) for name, entry in _entries(i, snapshot))
    return _cells(
        [
            terms[0],
            f"<mo>+</mo>{terms[1]}",
            f"<mo>+</mo>{terms[2]}",
            f"<mo>=</mo><mo>−</mo>{terms[3]}",
            '<mtext mathcolor="#888">+ coupling</mtext>' if coupled else "",
        ]
    )


def _term(name: str, i: int, factor: str, snapshot: Snapshot) -> str:
    grey = ' class="fixed"' if is_fixed(snapshot, name, i) else ""
    value = snapshot.matrices[name][i, i]
    return f'<mrow{grey}><mn>{value:.4g}</mn><mspace width="0.15em"/>{factor}</mrow>'


def _entries(i: int, snapshot: Snapshot) -> list[tuple[str, float]]:
    return [(name, float(snapshot.matrices[name][i, i])) for name in _NAMES]


def is_fixed(snapshot: Snapshot, name: str, i: int) -> bool:
    """Whether the mode fixes diagonal entry i of this matrix."""
    return name in snapshot.fixed and bool(snapshot.fixed[name][i, i])


def _cells(contents: list[str]) -> str:
    return "<mtr>" + "".join(f"<mtd>{content}</mtd>" for content in contents) + "</mtr>"


def _sub(base: str, index: str) -> str:
    return f"<msub><mi>{base}</mi><mi>{index}</mi></msub>"


def _error(index: str, accent: str = "") -> str:
    # composed letters: an accent of its own (<mover>) is lost in small type
    letter = {"": "e", "˙": "ė", "¨": "ë"}[accent]
    return f'<msub><mi style="font-style: italic">{letter}</mi><mi>{index}</mi></msub>'
