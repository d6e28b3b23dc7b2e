"""Table of the theorem in numbers, without controls."""

from __future__ import annotations

import math
from html import escape

import viser

from app.dashboard.widgets.chips import chip
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
    rows = _facts(snapshot)
    body = "".join(
        f'<tr title="{title}"><td>{what}</td><td>{value}</td><td>{verdict}</td></tr>'
        for what, value, verdict, title in rows
    )
    return f'<table class="vs-facts vs-verdicts">{body}</table>'


def _facts(snapshot: Snapshot) -> list[tuple[str, str, str, str]]:
    """Rows of the table: name, value against limit, verdict and explanation of each."""
    live, units = snapshot.live, snapshot.system.units

    def number(name: str, factor: float = 1.0) -> str:
        value = live.get(name, math.nan) * factor
        return f"<b>{0.0 if abs(value) < 1e-9 else value:.3g}</b>" if math.isfinite(value) else "—"

    def against(name: str, sign: str, limit: str, unit: str, factor: float = 1.0) -> str:
        return f"{number(name, factor)} {sign} {number(limit, factor)} {unit}"

    robust = snapshot.system.controller.law.robust
    rows = []
    if robust:
        allowed = live["s_bound"] + live["s_band"]
        epoch = snapshot.state.epoch
        rows += [
            (
                "gain d (17)",
                against("d", "≥", "d_required", units.force),
                judged(live["gain_margin"], f" {units.force}", low=-1e-9),
                "gain d, the gain that (17) requires including ε, and what is spare; with d by theorem that is 0",
            ),
            (
                "‖s‖, (20) + band",
                f"{number('s_norm', 1e3)} ≤ {f'{allowed * 1e3:.3g}' if math.isfinite(allowed) else '—'} {units.rate}",
                verdict(holds=live["s_norm"] <= allowed) if math.isfinite(allowed) else "",
                "the sliding variable and its bound, (20) plus the band of sampling and boundary layer; — where "
                "nothing is promised",
            ),
            ("band reached", *_reached(epoch.t, epoch.band_reached, epoch.band_reached_by)),
        ]
        if snapshot.system.controller.switching.has_layer:
            rows.append(("layer reached", *_reached(epoch.t, epoch.layer_reached, epoch.layer_reached_by)))
        layer = STATEMENTS[Premise.LAYER]
        layer_limit = snapshot.metrics.evaluation.read().table.limit[Premise.LAYER]
        rows.append(
            (
                layer.title,
                f"{number('layer_loop_factor')} {escape(layer.sign)} {layer_limit:g}",
                verdict(holds=live["layer_loop_factor"] < layer_limit),
                layer.why,
            )
        )
    if math.isfinite(live["force_loop_factor"]):
        rows.append(
            (
                "force loop, factor alone",
                f"|{number('force_loop_factor')}| &lt; 1",
                verdict(holds=abs(live["force_loop_factor"]) < 1.0),
                "factor by which one sample multiplies an error of the fed-back force; the premise of the sampled "
                "force loop adds the part that d by (17) causes",
            )
        )
    rows.append(
        ("residual of (8)", f"{number('residual')} {units.force}", "", "left side minus right side of the target model")
    )
    if robust:
        rows.append(
            (
                "V̂ = ½ sᵀĤs",
                f"{number('V', 1e3)} mJ",
                "",
                "the proof's Lyapunov function with the controller's estimate of H; the plot (tab Sliding) has that of "
                "the true arm",
            )
        )
    rows.append(
        (
            "<i>σ</i><sub>min</sub>(<i>J</i><sub>q</sub>)",
            f"{number('sigma_min')} {units.jacobian.removesuffix('1')}",
            "",
            "smallest singular value of J_q; Ω ends where it falls to the limit σ_min",
        )
    )
    return rows


def _reached(since: float, measured: float | None, promised: float | None) -> tuple[str, str, str]:
    """Cells on a time at which s reaches its goal: measured against promised time, verdict and explanation.
    since: instant from which both are counted, s. measured, promised: instants, s, None for unknown ones."""
    after = "not yet" if measured is None else f"<b>{measured - since:.3g}</b>"
    if promised is None:
        unit = "" if measured is None else " s"
        return f"{after}{unit}, no time promised", "", "the measured time, since the last change"
    badge = "" if measured is None else verdict(holds=measured <= promised + 1e-9)
    title = "the measured time and the promised one, since the last change"
    return f"{after} ≤ {promised - since:.3g} s", badge, title


def verdict(*, holds: bool) -> str:
    """Chip that says whether a condition holds."""
    return chip("holds", "vs-good") if holds else chip("violated", "vs-bad")


def judged(value: float, unit: str = "", low: float = -math.inf, high: float = math.inf) -> str:
    """Number as a chip, green within its limits and red outside; "—" where there is none."""
    if not math.isfinite(value):
        return "—"
    shown = 0.0 if abs(value) <= 1e-9 else value
    return chip(f"{shown:.3g}{unit}", "vs-good" if low <= value <= high else "vs-bad")
