"""Tiles of the robustness map, as a picture that says its numbers at the mouse."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape
from typing import NamedTuple

import numpy as np

from app.export.figures import plain_number
from app.scenario.schema import Scenario
from app.sweep.background import BackgroundSweep
from app.sweep.points import Points, interval
from app.sweep.question import Axis, Question

LEFT, RIGHT, TOP, BOTTOM, WIDTH, HEIGHT = 44, 330, 8, 196, 336, 248  # px, of the tiles and of all
STOPS = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))  # of viridis, evenly
SHADES = 24  # of the colour bar
NOTHING = "rgba(128, 128, 128, 0.18)"
WIDE = 100.0  # ratio from which on colours are by the logarithm


class Naming(NamedTuple):
    """Words of a map: what it shows, in which unit, of which `factor` make one SI unit, whether it is the share of the
    arms that keep a limit, and its axes by path, each with its unit."""

    title: str
    unit: str
    factor: float
    share: bool
    axes: Mapping[str, tuple[str, str]]


class _Frame(NamedTuple):
    """Size of a tile, px."""

    wide: float
    tall: float


def map_html(sweep: BackgroundSweep, points: Points | None, naming: Naming, present: Scenario) -> str:
    """Tiles with their numbers, the ends of the declared set, and a ring where the present setting is."""
    question, done = sweep.question, len(sweep.rows)
    told = f"{done} of {question.count} runs" + ("" if sweep.going or done == question.count else ", cancelled")
    told = escape(sweep.problem or told)
    if points is None:
        return f'<div class="vs-checks"><div class="vs-note">{told}</div></div>'
    x, y = question.sweep.vary
    numbers = points.number if naming.share else naming.factor * points.number
    low, high, logarithmic = (0.0, 1.0, False) if naming.share else _scale(numbers)
    frame = _Frame((RIGHT - LEFT) / len(x.values), (BOTTOM - TOP) / len(y.values))
    tiles, declared = [], {}
    for k, number in enumerate(numbers):
        i, j = (axis.values.index(float(points.values[axis.path][k])) for axis in (x, y))
        declared[i, j] = bool(points.declared[k])
        color = NOTHING if math.isnan(number) else _color(number, low, high, logarithmic=logarithmic)
        said = escape(_said(question, points, k, number, naming))
        cross = f'<path d="{_cross(i, j, frame)}" stroke="currentColor"/>' if points.stopped[k] else ""
        tiles.append(
            f'<g data-point="{i * len(y.values) + j}" tabindex="0" role="button" aria-label="{said}">'
            f'<rect x="{LEFT + i * frame.wide:.1f}" y="{BOTTOM - (j + 1) * frame.tall:.1f}" '
            f'width="{frame.wide - 0.6:.1f}" height="{frame.tall - 0.6:.1f}" fill="{color}"/>{cross}'
            f"<title>{said}</title></g>"
        )
    borders = _declared_ends(declared, frame)
    over = ", share of the arms that keep the limit" if naming.share else ", worst arm" if question.sweep.draw else ""
    return (
        f'<div class="vs-checks"><div class="vs-note">{escape(naming.title)}{over}: {told}'
        f"{'; red: the declared set ends' if borders else ''}; ring: the present setting</div>"
        f'<svg class="vs-poles vs-tiles" viewBox="0 0 {WIDTH} {HEIGHT}" role="group" '
        f'aria-label="{escape(naming.title)}">{"".join(tiles)}{borders}{_ring(question, present)}'
        f"{_ticks(x, y, frame, naming)}{_bar(low, high, naming)}</svg></div>"
    )


def _said(question: Question, points: Points, k: int, number: float, naming: Naming) -> str:
    where = ", ".join(
        f"{naming.axes[axis.path][0]} {_plain(float(points.values[axis.path][k]))} {naming.axes[axis.path][1]}".rstrip()
        for axis in question.sweep.vary
    )
    arms = int(points.arms[k])
    if points.stopped[k] and not naming.share:
        return f"{where}: a run stopped or was refused"
    if math.isnan(number):
        return f"{where}: no figure"
    if naming.share:
        low, high = interval(int(points.good[k]), arms)
        return f"{where}: {points.good[k]} of {arms} arms (95 %: {low:.2f} to {high:.2f})"
    return f"{where}: {naming.title} {_plain(number)} {naming.unit}" + (f", worst of {arms} arms" if arms > 1 else "")


def _scale(numbers: np.ndarray) -> tuple[float, float, bool]:
    """Least and largest number, and whether colours are by their logarithm."""
    known = numbers[np.isfinite(numbers)]
    if not len(known):
        return 0.0, 1.0, False
    low, high = float(known.min()), float(known.max())
    return low, high, low > 0.0 and high > WIDE * low


def _color(number: float, low: float, high: float, *, logarithmic: bool) -> str:
    if logarithmic:
        number, low, high = math.log(number), math.log(low), math.log(high)
    share = 0.0 if high <= low else min(max((number - low) / (high - low), 0.0), 1.0)
    at = share * (len(STOPS) - 1)
    k = min(int(at), len(STOPS) - 2)
    r, g, b = (round(one + (at - k) * (other - one)) for one, other in zip(STOPS[k], STOPS[k + 1], strict=True))
    return f"rgb({r}, {g}, {b})"


def _cross(i: int, j: int, frame: _Frame) -> str:
    x, y, r = LEFT + (i + 0.5) * frame.wide, BOTTOM - (j + 0.5) * frame.tall, 0.22 * min(frame)
    return f"M {x - r:.1f} {y - r:.1f} l {2 * r:.1f} {2 * r:.1f} M {x - r:.1f} {y + r:.1f} l {2 * r:.1f} {-2 * r:.1f}"


def _declared_ends(declared: Mapping[tuple[int, int], bool], frame: _Frame) -> str:
    parts = []
    for (i, j), held in declared.items():
        x, y = LEFT + i * frame.wide, BOTTOM - j * frame.tall
        if declared.get((i + 1, j), held) != held:
            parts.append(f"M {x + frame.wide:.1f} {y:.1f} v {-frame.tall:.1f}")
        if declared.get((i, j + 1), held) != held:
            parts.append(f"M {x:.1f} {y - frame.tall:.1f} h {frame.wide:.1f}")
    d = " ".join(parts)
    return f'<path class="vs-ends" fill="none" stroke="#e84040" stroke-width="2" d="{d}"/>' if parts else ""


def _ring(question: Question, present: Scenario) -> str:
    """Ring at the present setting, where it is on the map."""
    at = []
    for axis in question.sweep.vary:
        value: object = present
        for part in axis.path.split("."):
            value = getattr(value, part, None)
        values = np.array(axis.values, dtype=float)
        if not isinstance(value, int | float) or not values[0] <= value <= values[-1]:
            return ""
        at.append(float(np.interp(value, values, np.arange(len(values)))) + 0.5)
    x, y = question.sweep.vary
    across, up = LEFT + at[0] * (RIGHT - LEFT) / len(x.values), BOTTOM - at[1] * (BOTTOM - TOP) / len(y.values)
    circle = f'cx="{across:.1f}" cy="{up:.1f}" r="6" fill="none" pointer-events="none"'
    return (
        f'<circle {circle} stroke="white" stroke-width="3"/>'
        f'<circle class="vs-present" {circle} stroke="black" stroke-width="1.2"/>'
    )


def _ticks(x: Axis, y: Axis, frame: _Frame, naming: Naming) -> str:
    across, up = (f"{name}{f' [{unit}]' if unit else ''}" for name, unit in (naming.axes[x.path], naming.axes[y.path]))
    return "".join([
        *(
            f'<text x="{LEFT + (k + 0.5) * frame.wide:.1f}" y="{BOTTOM + 11}" text-anchor="middle">'
            f"{_plain(float(x.values[k]))}</text>"
            for k in (0, len(x.values) // 2, len(x.values) - 1)
        ),
        *(
            f'<text x="{LEFT - 4}" y="{BOTTOM - (k + 0.5) * frame.tall + 4:.1f}" text-anchor="end">'
            f"{_plain(float(y.values[k]))}</text>"
            for k in (0, len(y.values) // 2, len(y.values) - 1)
        ),
        f'<text x="{RIGHT}" y="{BOTTOM + 23}" text-anchor="end">→ {escape(across)}</text>',
        f'<text x="4" y="{BOTTOM + 23}">↑ {escape(up)}</text>',
    ])  # fmt: skip


def _bar(low: float, high: float, naming: Naming) -> str:
    step = (RIGHT - LEFT) / SHADES
    shades = "".join(
        f'<rect x="{LEFT + k * step:.1f}" y="226" width="{step + 0.5:.1f}" height="7" '
        f'fill="{_color(k / (SHADES - 1), 0.0, 1.0, logarithmic=False)}"/>'
        for k in range(SHADES)
    )
    left, right = ("0", "1") if naming.share else (f"{_plain(each)} {naming.unit}" for each in (low, high))
    return f'{shades}<text x="{LEFT}" y="244">{left}</text><text x="{RIGHT}" y="244" text-anchor="end">{right}</text>'


def _plain(value: float) -> str:
    return plain_number(float(f"{value:.3g}"), None)
