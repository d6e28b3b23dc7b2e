"""Table of the constants behind the theorem's promise: declared, found by a search over Omega, and used."""

from __future__ import annotations

from html import escape

from app.scenario.field_info import field_info
from app.scenario.number_text import rounded
from app.scenario.schema import STATED_IN, Declared
from app.session.snapshot import Snapshot
from app.simulation.omega.domain import MARGIN

_NAMES = {
    "coulomb": "Coulomb friction", "viscous": "viscous friction", "least_inertia": "M ≥ M̂ ×", "delta_M": "δ_M",
    "delta_C": "δ_C", "delta_G": "δ_G", "delta_f": "δ_f",
}  # fmt: skip


def constants_html(snapshot: Snapshot) -> str:
    """Table of the constants as HTML: a row for each, with its unit."""
    rows = "".join(
        f'<tr title="{escape(about)}"><td>{escape(name)}</td><td>{declared}</td><td>{found}</td><td>{used}</td>'
        f"<td>{escape(unit)}</td></tr>"
        for name, about, declared, found, used, unit in (*_declared(snapshot), *_searched(snapshot))
    )
    heads = "".join(f"<td>{head}</td>" for head in ("constant", "declared", "found", "used", "unit"))
    return (
        f'<table class="vs-facts vs-premises"><tr>{heads}</tr>{rows}</table>'
        f'<div class="vs-note">Found: the largest value of any declared arm in a search over Ω (k_r′: the least). '
        f"Used: {100 * (MARGIN - 1.0):.0f} % more (k_r′: less), since a search may miss the extreme.</div>"
    )


def _declared(snapshot: Snapshot) -> list[tuple[str, ...]]:
    """Rows of the declared bounds, which are used as they are."""
    rows = []
    stated = snapshot.state.evaluation.read().seen.estimate.stated
    for name in Declared.__struct_fields__:
        info, given = field_info(f"declared.{name}"), getattr(snapshot.scenario.declared, name)
        if given is None or (name == "least_inertia" and snapshot.scenario.declared.delta_M is None):
            continue
        value = escape(given) if isinstance(given, str) else rounded(given)
        rows.append(
            (
                _NAMES.get(name, name.replace("_", " ")),
                info.doc,
                value,
                "—",
                rounded(getattr(stated, name)).replace("nan", "—") if name in STATED_IN else value,
                info.unit_in(snapshot.system.units),
            )
        )
    return rows


def _searched(snapshot: Snapshot) -> list[tuple[str, ...]]:
    """Rows of the constants that a search over Omega finds."""
    constants = snapshot.system.constants
    declared, rates = snapshot.scenario.declared, constants.rates
    in_doubt = declared.link_centre > 0.0 or declared.link_shape > 0.0
    units = snapshot.system.units
    lipschitz, mass = constants.lipschitz, units.of_model["M_m"]
    rows = [
        ("k_r″", "largest eigenvalue of H", constants.k_r_high, mass),
        ("k_C", "‖C‖ per rad/s, summed over the links", constants.k_C, "kg·m²/rad"),
    ]
    if in_doubt:
        rows += [
            ("k_Cc", "‖ΔC‖ per rad/s and m of the links' centres of mass", rates.k_centre, "kg·m/rad"),
            ("k_Ccc", "‖ΔC‖ per rad/s and m² of the links' centres of mass", rates.k_swing, "kg/rad"),
            ("k_CI", "‖ΔC‖ per rad/s and share of the links' inertias", rates.k_shape, "kg·m²/rad"),
        ]
    if lipschitz is not None:
        rows += [
            ("k_M", "change of M̂ per rad, for estimates along r_d (Remark 3)", lipschitz.k_M, "kg·m²/rad"),
            ("k_Cq", "change of Ĉ per rad/s and rad, for these", lipschitz.k_Cq, "kg·m²"),
            ("k_G", "change of Ĝ per rad, for these", lipschitz.k_G, "N·m/rad"),
        ]
    low = constants.k_r_low
    return [
        ("k_r′", "least eigenvalue of H", "—", rounded(low * MARGIN, 4), rounded(low, 4), units.of_joints(mass))
    ] + [
        (name, about, "—", rounded(used / MARGIN, 4), rounded(used, 4), units.of_joints(unit))
        for name, about, used, unit in rows
    ]
