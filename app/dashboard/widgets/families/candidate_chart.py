"""Picture of a search for gains: its candidates over their two aims, or over their numbers where the search has one
aim, and their front."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from app.dashboard.widgets.families.map_tiles import BOTTOM, LEFT, RIGHT, TOP, WIDTH, ColorScale, caption_html
from app.scenario.number_text import in_one_style, rounded
from app.storage.joint_kinds import units_of
from app.sweep.run_metrics import COLUMNS, metric_title
from app.sweep.titles import unit_of
from app.tune.background import BackgroundTuning
from app.tune.candidates import Candidate
from app.tune.plan import in_words

HEIGHT, FIELD = 224, "vs-candidate-field"
EDGE = 8  # px, between the axes and the candidates
DECADE = 10.0  # ratio of an aim's values from which on their axis is logarithmic: else one far out hides the others


def candidates_html(tuning: BackgroundTuning, names: Mapping[str, str], chosen: int | None) -> str:
    """Picture of the candidates so far.
    names: of the gains, by path.
    chosen: number of the previewed candidate, None for none."""
    progress, best = _progress_html(tuning), tuning.front  # the front first: candidates come in meanwhile
    shown = [each for each in tuning.candidates if all(map(math.isfinite, each.aims))]
    if not shown:
        return f'<div class="vs-checks"><div class="vs-note">{progress}</div></div>'
    aims, red = tuning.tuning.aims, {each.number for each in best}
    at = {each.number: _place(each) for each in shown}
    # what is over a limit, and never offered, lies at the picture's edge where its aims are beyond those of the others
    offered = [at[each.number] for each in shown if not each.badge or each.number == 0]
    places = np.array(offered or list(at.values()))
    across = _scale(places[:, 0] if len(aims) > 1 else np.array(list(at)), of_aim=len(aims) > 1)  # all have a number
    up = _scale(places[:, 1], of_aim=True)
    x = {number: LEFT + EDGE + across.position(place[0]) * (RIGHT - LEFT - 2 * EDGE) for number, place in at.items()}
    y = {number: BOTTOM - EDGE - up.position(place[1]) * (BOTTOM - TOP - 2 * EDGE) for number, place in at.items()}
    marks = [
        _mark(
            *(each, x[each.number], y[each.number], _label(tuning, each, names), chosen),
            in_front=each.number in red,
            first=each.number == min(at),
        )
        for each in sorted(shown, key=lambda each: (each.number in red, each.number == 0, not each.badge))
    ]
    first, *others = (in_words(aim, units_of(tuning.tuning.scenario)) for aim in aims)
    names_of_axes = (first, others[0]) if others else ("candidate", first)
    names_of_axes = tuple(
        f"{name}, logarithmic" if scale.logarithmic else name
        for name, scale in zip(names_of_axes, (across, up), strict=True)
    )
    state = (' data-previewed=""' if chosen is not None else "") + (' data-going=""' if tuning.going else "")
    steps = _front([(x[each.number], y[each.number]) for each in best]) if len(aims) > 1 else ""
    return (
        f'<div class="vs-checks"><div class="vs-note">{progress}. Red: the front; star: the present gains at the start'
        f"; cross: never offered, such as over a limit</div>{caption_html(FIELD)}"
        f'<svg class="vs-poles vs-tiles" data-field="{FIELD}"{state} viewBox="0 0 {WIDTH} {HEIGHT}" role="group" '
        f'aria-label="candidates: one shows what it would do, chosen again it is applied">'
        f'<path class="axis" fill="none" d="M {LEFT} {TOP} V {BOTTOM} H {RIGHT}"/>{steps}{"".join(marks)}'
        f"{_axes(names_of_axes, across, up)}</svg></div>"
    )


def _progress_html(tuning: BackgroundTuning) -> str:
    """Progress of the search, as HTML."""
    if tuning.problem:
        return escape(tuning.problem)
    if tuning.waiting:
        return "It waits until the maps and searches of other visitors are done"
    judged, points = max(len(tuning.candidates) - 1, 0), tuning.tuning.points - 1
    if tuning.complete:
        return f"{judged} candidates in {tuning.runs} runs"
    progress = f"{judged} of {points} candidates, {tuning.runs} of at most {tuning.most} runs"
    return progress if tuning.going else f"{progress}, cancelled"


def name_of(number: int) -> str:
    """Name of the candidate of this number."""
    return f"candidate {number}" if number else "own gains"


def gains_in_words(tuning: BackgroundTuning, candidate: Candidate, names: Mapping[str, str]) -> str:
    """Gains of a candidate, in words."""
    units = units_of(tuning.tuning.scenario)
    return ", ".join(
        f"{names[path]} {rounded(float(value))} {unit_of(path, units)}".rstrip()
        for path, value in candidate.values.items()
    )


def _description(tuning: BackgroundTuning, candidate: Candidate, names: Mapping[str, str]) -> str:
    """Description of a candidate: its name, gains and aims, in words."""
    gains, units = gains_in_words(tuning, candidate, names), units_of(tuning.tuning.scenario)
    metrics = ", ".join(
        f"{metric_title(aim)} {rounded(value)} {COLUMNS[aim].unit_in(units)}".rstrip()
        for aim, value in zip(tuning.tuning.aims, candidate.aims, strict=True)
    )
    return f"{name_of(candidate.number)}{gains and f', {gains}'}: {metrics}"


def _label(tuning: BackgroundTuning, candidate: Candidate, names: Mapping[str, str]) -> str:
    arms = f", worst of {tuning.tuning.seen} arms" if tuning.tuning.draw else ""
    badge = f". Not offered: {candidate.badge}" if candidate.badge else ""
    return f"{_description(tuning, candidate, names)}{arms}{badge}"


def _place(candidate: Candidate) -> tuple[float, float]:
    """Position of a candidate in the picture: its two aims, or its number and its only aim."""
    first, *others = candidate.aims
    return (first, others[0]) if others else (float(candidate.number), first)


def _scale(values: np.ndarray, *, of_aim: bool) -> ColorScale:
    """Axis over these values: of an aim, or of the candidates' numbers, which is linear."""
    low, high = float(values.min()), float(values.max())
    return ColorScale(low, high, of_aim and 0.0 < DECADE * low < high)


def _mark(
    candidate: Candidate, x: float, y: float, label: str, chosen: int | None, *, in_front: bool, first: bool
) -> str:
    """Mark of a candidate, as SVG. first: whether the key Tab leads to it, from which the arrows go on."""
    if candidate.number == 0:
        shape = f'<path class="vs-own" d="{_star(x, y)}"/>'
    elif candidate.badge:
        shape = f'<path class="vs-badged" d="M {x - 3:.1f} {y - 3:.1f} l 6 6 m -6 0 l 6 -6"/>'
    else:
        look, radius = ("vs-best", 4) if in_front else ("vs-tried", 3)
        shape = f'<circle class="{look}" cx="{x:.1f}" cy="{y:.1f}" r="{radius}"/>'
    ring = f'<circle class="vs-chosen-ring" cx="{x:.1f}" cy="{y:.1f}" r="8"/>' if candidate.number == chosen else ""
    return (
        f'<g data-point="{candidate.number}" data-at="{x:.1f},{HEIGHT - y:.1f}" role="button" '
        f'tabindex="{0 if first else -1}" aria-label="{escape(label)}">'
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="7" fill="transparent"/>{shape}{ring}</g>'
    )


def _front(best: Sequence[tuple[float, float]]) -> str:
    """Line of steps between the candidates of the front, as SVG."""
    if not best:
        return ""
    steps = [f"M {best[0][0]:.1f} {best[0][1]:.1f}"] + [f"H {x:.1f} V {y:.1f}" for x, y in best[1:]]
    return f'<path class="vs-front" d="{" ".join(steps)}"/>'


def _star(x: float, y: float) -> str:
    places = [
        (x + r * math.sin(k * math.pi / 5), y - r * math.cos(k * math.pi / 5))
        for k in range(10)
        for r in (6.5 if k % 2 == 0 else 2.6,)
    ]
    return "M " + " L ".join(f"{a:.1f} {b:.1f}" for a, b in places) + " Z"


def _axes(names: Sequence[str], across: ColorScale, up: ColorScale) -> str:
    left, right = in_one_style((across.low, across.high))
    return "".join([
        f'<text x="{LEFT + EDGE}" y="{BOTTOM + 11}">{left}</text>',
        f'<text x="{RIGHT}" y="{BOTTOM + 11}" text-anchor="end">{right}</text>',
        *(f'<text x="{LEFT - 4}" y="{y + 4}" text-anchor="end">{value}</text>'
          for y, value in zip((BOTTOM - EDGE, TOP + EDGE), in_one_style((up.low, up.high)), strict=True)),
        f'<text x="{RIGHT}" y="{BOTTOM + 23}" text-anchor="end">→ {escape(names[0])}</text>',
        f'<text x="4" y="{BOTTOM + 23}">↑ {escape(names[1])}</text>',
    ])  # fmt: skip
