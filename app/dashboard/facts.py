"""The theorem in numbers: a small table that is read, not edited."""

from __future__ import annotations

import math

import viser

from app.runner import Snapshot


class Facts:
    """Gain condition, reaching time and the factors of the sampled loops, each with its limit."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._html = gui.add_html("")

    def show(self, snapshot: Snapshot) -> None:
        rows = "".join(f"<tr><td>{what}</td><td>{value}</td></tr>" for what, value in _facts(snapshot))
        self._html.content = f'<table class="vs-facts">{rows}</table>'


def _facts(snapshot: Snapshot) -> list[tuple[str, str]]:
    live = snapshot.live

    def number(name: str, unit: str = "") -> str:
        value = live.get(name, math.nan)
        return f"<b>{value:.3g}</b>{unit}" if math.isfinite(value) else "—"

    rows = [
        ("gain d, needed by (17)", f"{number('d')}, {number('d_required')} N"),
        ("margin of the gain condition", _judged(live.get("gain_margin", math.nan), " N", low=-1e-9)),
        ("reaching time, promised by (18)", f"{number('reaching_time')}, ≤ {number('reaching_time_bound')} s"),
        ("Lyapunov function V", number("V", " J")),
        ("residual of the target model", number("residual", " N")),
        ("loop factor in the layer (&lt; 2)", _judged(live.get("layer_loop_factor", math.nan), "", high=2.0)),
        ("smallest singular value of J_q", number("sigma_min", " m")),
    ]
    if math.isfinite(live.get("force_loop_factor", math.nan)):
        rows.append(("force loop factor (&lt; 1)", _judged(abs(live["force_loop_factor"]), "", high=1.0)))
    return rows


def _judged(value: float, unit: str, low: float = -math.inf, high: float = math.inf) -> str:
    if not math.isfinite(value):
        return "—"
    look = "vs-good" if low <= value <= high else "vs-bad"
    return f'<span class="vs-chip {look}">{value if abs(value) > 1e-9 else 0.0:.3g}{unit}</span>'
