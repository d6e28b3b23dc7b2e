"""Table of the theorem in numbers, without controls."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from typing import NamedTuple

import viser

from app.dashboard.widgets.chips import chip
from app.scenario.number_text import rounded, without_rounding
from app.session.snapshot import Snapshot
from controllers.premise_statements import STATEMENTS
from controllers.premises import Premise


class TheoremTable:
    """Table of the theorem's statements: gain condition, reaching time, sliding variable and the factors of the sampled
    loops, each with its limit."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._html = gui.add_html("")

    def show(self, snapshot: Snapshot) -> None:
        self._html.content = facts_html(snapshot)


def facts_html(snapshot: Snapshot) -> str:
    """Table as HTML: each measured value, the value that the theorem requires or promises, and whether it holds now."""
    body = "".join(
        f'<tr title="{fact.why}"><td>{fact.name}</td><td>{fact.value}</td><td>{fact.badge}</td></tr>'
        for fact in _facts(snapshot)
    )
    return f'<table class="vs-facts vs-verdicts">{body}</table>'


class _Fact(NamedTuple):
    """Row of the table, as HTML: name, value against limit, badge with the verdict, and explanation."""

    name: str
    value: str
    badge: str
    why: str


@dataclass(frozen=True)
class _LiveNumbers:
    """Numbers of a snapshot's last control period, as HTML. values: by signal."""

    values: Mapping[str, float]

    def number(self, name: str, factor: float = 1.0) -> str:
        """One number; a dash where there is none."""
        value = self.values.get(name, math.nan) * factor
        return f"<b>{rounded(without_rounding(value))}</b>" if math.isfinite(value) else "—"

    def against(self, name: str, sign: str, limit: str, unit: str) -> str:
        """A number against another one."""
        return f"{self.number(name)} {sign} {self.number(limit)} {unit}"


def _facts(snapshot: Snapshot) -> list[_Fact]:
    """Rows of the table."""
    live, units, robust = _LiveNumbers(snapshot.live), snapshot.system.units, snapshot.system.controller.law.robust
    facts = _facts_of_gain_and_bound(snapshot, live) if robust else []
    force_loop = snapshot.live["force_loop_factor"]
    if math.isfinite(force_loop):
        facts.append(
            _Fact(
                "force loop, factor alone",
                f"|{live.number('force_loop_factor')}| &lt; 1",
                holds_chip(holds=abs(force_loop) < 1.0),
                "factor by which one sample multiplies an error of the fed-back force; the premise of the sampled "
                "force loop adds the part that d by (17) causes",
            )
        )
    residual = f"{live.number('residual')} {units.force}"
    facts.append(_Fact("residual of (8)", residual, "", "left side minus right side of the target model"))
    if robust:
        facts.append(
            _Fact(
                "V̂ = ½ sᵀĤs",
                f"{live.number('V', 1e3)} mJ",
                "",
                "the proof's Lyapunov function with the controller's estimate of H; the plot (tab Sliding) has that of "
                "the true arm",
            )
        )
    facts.append(
        _Fact(
            "<i>σ</i><sub>min</sub>(<i>J</i><sub>q</sub>)",
            f"{live.number('sigma_min')} {units.jacobian.removesuffix('1')}",
            "",
            "smallest singular value of J_q; Ω ends where it falls to the limit σ_min",
        )
    )
    return facts


def _facts_of_gain_and_bound(snapshot: Snapshot, live: _LiveNumbers) -> list[_Fact]:
    """Rows that only the law of Theorem 1 has: its gain, the bound on s, when s gets there, and the layer's limit."""
    numbers, epoch, units = snapshot.live, snapshot.state.epoch, snapshot.system.units
    allowed = numbers["s_bound"] + numbers["s_band"]
    bound = rounded(allowed * 1e3) if math.isfinite(allowed) else "—"
    facts = [
        _Fact(
            "gain d (17)",
            live.against("d", "≥", "d_required", units.force),
            number_chip(numbers["gain_margin"], f" {units.force}", low=-1e-9),
            "gain d, the gain that (17) requires including ε, and what is spare; with d by theorem that is 0",
        ),
        _Fact(
            "‖s‖, (20) + band",
            f"{live.number('s_norm', 1e3)} ≤ {bound} {units.rate}",
            holds_chip(holds=numbers["s_norm"] <= allowed) if math.isfinite(allowed) else "",
            "the sliding variable and its bound, (20) plus the band of sampling and boundary layer; — where "
            "nothing is promised",
        ),
        _Fact("band reached", *_reached(epoch.t, epoch.band_reached, epoch.band_reached_by)),
    ]
    if snapshot.system.controller.switching.has_layer:
        facts.append(_Fact("layer reached", *_reached(epoch.t, epoch.layer_reached, epoch.layer_reached_by)))
    layer = STATEMENTS[Premise.LAYER]
    limit = snapshot.metrics.evaluation.read().table.limit[Premise.LAYER]
    value = f"{live.number('layer_loop_factor')} {escape(layer.sign)} {limit:g}"
    facts.append(_Fact(layer.title, value, holds_chip(holds=numbers["layer_loop_factor"] < limit), layer.why))
    return facts


def _reached(since: float, measured: float | None, promised: float | None) -> tuple[str, str, str]:
    """Cells on a time at which s reaches its goal: measured against promised time, verdict and explanation.
    since: instant from which both are counted, s. measured, promised: instants, s, None for unknown ones."""
    after = "not yet" if measured is None else f"<b>{measured - since:.3g}</b>"
    if promised is None:
        unit = "" if measured is None else " s"
        return f"{after}{unit}, no time promised", "", "the measured time, since the last change"
    badge = "" if measured is None else holds_chip(holds=measured <= promised + 1e-9)
    title = "the measured time and the promised one, since the last change"
    return f"{after} ≤ {promised - since:.3g} s", badge, title


def holds_chip(*, holds: bool) -> str:
    """Chip that says whether a condition holds."""
    return chip("holds", "vs-good") if holds else chip("violated", "vs-bad")


def number_chip(value: float, unit: str = "", low: float = -math.inf, high: float = math.inf) -> str:
    """Number as a chip, green within its limits and red outside; "—" where there is none."""
    if not math.isfinite(value):
        return "—"
    return chip(f"{rounded(without_rounding(value))}{unit}", "vs-good" if low <= value <= high else "vs-bad")
