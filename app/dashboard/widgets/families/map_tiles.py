"""Picture of the robustness map: tiles over two fields, or dots over one; each has its numbers as text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape
from typing import NamedTuple

import numpy as np

from app.scenario.number_text import in_one_style, rounded
from app.sweep.axes import Axis
from app.sweep.background import BackgroundSweep
from app.sweep.charts import wide
from app.sweep.plan import SweepPlan
from app.sweep.points import Points, interval
from app.sweep.titles import value_in_words
from controllers.premise_statements import STATEMENTS
from controllers.premises import Premise

LEFT, RIGHT, TOP, BOTTOM, WIDTH, HEIGHT = 44, 330, 8, 196, 336, 248  # px, of the tiles and of the whole picture
COURSE_HEIGHT = 224  # px, of a picture over one field, which has no colour bar
GAP = 0.8  # px, around a tile, which can be pressed, too; neighbours do not cover the outline that tells the focus
STOPS = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))  # evenly spaced colours of viridis
SHADES = 24  # of the colour bar
NO_DATA_COLOR = "rgba(128, 128, 128, 0.18)"
FIELD = "vs-tile-field"
Present = Mapping[str, float | None]


class Naming(NamedTuple):
    """Words of a map.
    title: of the figure that the map shows.
    unit: of this figure.
    factor: from the SI unit to `unit`.
    limit: of which the map shows the share of the arms that keep it instead, "" for none.
    axes: name and unit of each axis, by path."""

    title: str
    unit: str
    factor: float
    limit: str
    axes: Mapping[str, tuple[str, str]]

    @property
    def share(self) -> bool:
        """Whether the map shows the share of the arms that keep a limit."""
        return bool(self.limit)


class _Frame(NamedTuple):
    """Size of a tile, px."""

    wide: float
    tall: float


class ColorScale(NamedTuple):
    """Scale of a map's numbers: the least, the largest, and whether the colours follow the logarithm."""

    low: float
    high: float
    logarithmic: bool

    @classmethod
    def of(cls, numbers: np.ndarray) -> ColorScale:
        """Scale of the finite ones among the numbers, of which there is at least one."""
        known = numbers[np.isfinite(numbers)]
        low, high = float(known.min()), float(known.max())
        return cls(low, high, wide(known))

    def position(self, number: float) -> float:
        """Position of a number on the scale, 0 to 1."""
        low, high = self.low, self.high
        if self.logarithmic:
            number, low, high = math.log(max(number, low)), math.log(low), math.log(high)
        return 0.0 if high <= low else min(max((number - low) / (high - low), 0.0), 1.0)


def map_html(sweep: BackgroundSweep, points: Points | None, naming: Naming, present: Present) -> str:
    """Map as HTML: tiles with their numbers, lines where the declared set and (17) end, a ring at the present values.
    present: values of the axes by path, None for unknown ones; empty where the map is of another scenario."""
    plan, progress = sweep.plan, _progress_html(sweep)
    if points is None:
        return f'<div class="vs-checks"><div class="vs-note">{progress}</div></div>'
    numbers = points.number if naming.share else naming.factor * points.number
    title = naming.title[:1].upper() + naming.title[1:]
    words = [f"{escape(title)}{_what_of_it(plan, points, naming, whole=len(sweep.rows) == plan.count)}"]
    if len(plan.sweep.vary) == 1:
        picture, ends, height = _course(plan, points, numbers, naming, present), [], COURSE_HEIGHT
    else:
        picture, ends, height = (*_tiles(plan, points, numbers, naming, present), HEIGHT)
    words += [progress, *ends]
    if not sweep.going and not np.isfinite(numbers).any():
        nowhere = "No run of this scenario has this figure"
        words.append(nowhere if points.absent.any() else "At every setting some arm has no value")
    if all(_place(axis, present.get(axis.path)) is not None for axis in plan.sweep.vary):
        words.append(f"The {'ring' if len(plan.sweep.vary) > 1 else 'blue line'} is the present setting")
    going = ' data-going=""' if sweep.going else ""
    return (
        f'<div class="vs-checks"><div class="vs-note">{". ".join(words)}.</div>{caption_html(FIELD)}'
        f'<svg class="vs-poles vs-tiles" data-field="{FIELD}"{going} viewBox="0 0 {WIDTH} {height}" role="group" '
        f'aria-label="{escape(naming.title)}: a tile opens its run">{picture}</svg></div>'
    )


def _what_of_it(plan: SweepPlan, points: Points, naming: Naming, *, whole: bool) -> str:
    """Words on what the map shows of its figure, as HTML. whole: whether all runs are there."""
    limit = f"the limit of {escape(naming.limit)}"
    if plan.sweep.draw:
        return f", share of the arms that keep {limit}" if naming.share else ", worst arm"
    if not naming.share:
        return ""
    if whole:
        return f": {int(points.good.sum())} of {plan.count} runs keep {limit}"
    return f", whether the run keeps {limit}"


def caption_html(field: str) -> str:
    """Line in which the page's script shows the text of the tile under the pointer or with the focus, as HTML."""
    return f'<div class="vs-description" data-of="{field}" aria-hidden="true"></div>'


def _progress_html(sweep: BackgroundSweep) -> str:
    """Progress of the map, as HTML."""
    done, count = len(sweep.rows), sweep.plan.count
    if sweep.problem:
        return escape(sweep.problem)
    if sweep.waiting:
        return "It waits until the maps and searches of other visitors are done"
    return f"{done} of {count} runs" + (" are computed" if sweep.going or done == count else ", cancelled")


def _scale(numbers: np.ndarray, naming: Naming) -> ColorScale | None:
    """Scale of the numbers that a map shows, None where none of them is finite."""
    if not np.isfinite(numbers).any():
        return None
    return ColorScale(0.0, 1.0, False) if naming.share else ColorScale.of(numbers)


def _tiles(
    plan: SweepPlan, points: Points, numbers: np.ndarray, naming: Naming, present: Present
) -> tuple[str, list[str]]:
    """Picture over two fields, as SVG, and sentences on its lines."""
    x, y = plan.sweep.vary
    scale = _scale(numbers, naming)
    frame = _Frame((RIGHT - LEFT) / len(x.values), (BOTTOM - TOP) / len(y.values))
    tiles, declared, theorem = [], {}, {}
    for k, number in enumerate(numbers):
        i, j = (axis.values.index(float(points.values[axis.path][k])) for axis in (x, y))
        for holds, of_points in ((declared, points.declared), (theorem, points.theorem)):
            if not math.isnan(of_points[k]):
                holds[i, j] = bool(of_points[k])
        color = NO_DATA_COLOR if scale is None or math.isnan(number) else _color(scale.position(number))
        x_at, y_at = LEFT + i * frame.wide, BOTTOM - (j + 1) * frame.tall
        cross = f'<path d="{_cross(i, j, frame)}" stroke="currentColor"/>' if points.stopped[k] else ""
        label = escape(_label(plan, points, k, number, naming))
        tiles.append(
            f'<g data-point="{i * len(y.values) + j}" data-at="{i},{j}" tabindex="{-1 if tiles else 0}" role="button" '
            f'aria-label="{label}">'
            f'<rect x="{x_at + GAP:.1f}" y="{y_at + GAP:.1f}" '
            f'width="{frame.wide - 2 * GAP:.1f}" height="{frame.tall - 2 * GAP:.1f}" fill="{color}"/>{cross}'
            f'<rect x="{x_at:.2f}" y="{y_at:.2f}" width="{frame.wide:.2f}" height="{frame.tall:.2f}" '
            'fill="transparent"/></g>'
        )
    red = _ends(declared, frame, 'class="vs-ends" stroke="#e84040" stroke-width="2"')
    dashed = _ends(
        theorem, frame, 'class="vs-theorem" stroke="currentColor" stroke-width="1.6" stroke-dasharray="4 2.5"'
    )
    words = ["The red line is the edge of the declared set"] if red else []
    words += ["The dashed line is the edge of where d covers (17)"] if dashed else []
    bar = "" if scale is None else _bar(plan, scale, naming)
    return f"{''.join(tiles)}{red}{dashed}{_ring(plan, present)}{_ticks(x, y, frame, naming)}{bar}", words


def _course(plan: SweepPlan, points: Points, numbers: np.ndarray, naming: Naming, present: Present) -> str:
    """Picture over one field, as SVG: a dot for each value, with Wilson's interval where the map shows a share of arms
    that are drawn."""
    (x,) = plan.sweep.vary
    scale = _scale(numbers, naming)
    wide = (RIGHT - LEFT) / len(x.values)
    dots, lines = [], [list[str]()]
    for k in np.argsort(np.asarray(points.values[x.path], dtype=float)):
        number, i = float(numbers[k]), x.values.index(float(points.values[x.path][k]))
        across, label = LEFT + (i + 0.5) * wide, escape(_label(plan, points, int(k), number, naming))
        known = not math.isnan(number)
        up = BOTTOM if scale is None or not known else _up(scale.position(number))
        shape = f'<circle cx="{across:.1f}" cy="{up:.1f}" r="3.5" class="vs-dot-of"/>' if known else ""
        if points.stopped[k]:
            shape = f'<path d="M {across - 4:.1f} {up - 4:.1f} l 8 8 m -8 0 l 8 -8" stroke="currentColor"/>'
        elif known:
            lines[-1].append(f"{across:.1f} {up:.1f}")
        if points.stopped[k] or not known:
            lines.append([])
        if known and naming.share and plan.sweep.draw:
            low, high = (_up(end) for end in interval(int(points.good[k]), int(points.counted[k])))
            shape += f'<path d="M {across:.1f} {low:.1f} V {high:.1f}" class="vs-interval"/>'
        dots.append(
            f'<g data-point="{i}" data-at="{i},0" tabindex="{-1 if dots else 0}" role="button" aria-label="{label}">'
            f'<rect x="{LEFT + i * wide:.1f}" y="{TOP}" width="{wide:.1f}" height="{BOTTOM - TOP}" fill="transparent"/>'
            f"{shape}</g>"
        )
    name, unit = naming.axes[x.path]
    called = escape(f"{name} [{unit}]" if unit else name)
    at = _place(x, present.get(x.path))
    now = "" if at is None else f'<path class="vs-present" d="M {LEFT + at * wide:.1f} {TOP} V {BOTTOM}"/>'
    return "".join([
        f'<path class="axis" fill="none" d="M {LEFT} {TOP} V {BOTTOM} H {RIGHT}"/>{now}',
        *(f'<polyline class="vs-course" points="{", ".join(line)}"/>' for line in lines if line),
        *dots,
        *([] if scale is None else _ticks_up(plan, scale, naming)),
        *_ticks_across(x, wide),
        f'<text x="{RIGHT}" y="{BOTTOM + 23}" text-anchor="end">→ {called}</text>',
    ])  # fmt: skip


def _up(position: float) -> float:
    """Vertical position, px, of a position on the scale; its ends are a little off the axes."""
    return BOTTOM - 8 - position * (BOTTOM - TOP - 16)


def _label(plan: SweepPlan, points: Points, k: int, number: float, naming: Naming) -> str:
    named = [
        (*naming.axes[axis.path], value_in_words(axis.path, float(points.values[axis.path][k])))
        for axis in plan.sweep.vary
    ]
    where = ", ".join(f"{name} {value} {unit}".rstrip() for name, unit, value in named)
    arms = int(points.counted[k])
    if points.stopped[k] and math.isnan(number):
        return f"{where}: a run stopped or was refused"
    if points.never[k]:
        return f"{where}: {naming.title}: no value on some arm{_unpromised(points, k)}"
    if math.isnan(number):
        return f"{where}: no figure"
    more = ("; a run stopped or was refused" if points.stopped[k] else "") + _unpromised(points, k)
    if naming.share and not plan.sweep.draw:  # one run is no sample
        return f"{where}: {'keeps' if points.good[k] else 'does not keep'} the limit of {naming.limit}{more}"
    if naming.share:
        low, high = interval(int(points.good[k]), arms)
        count = f"{points.good[k]} of {arms} arms keep the limit of {naming.limit}"
        return f"{where}: {count} (95 %: {low:.2f} to {high:.2f} of arms drawn like these){more}"
    worst = f", worst of {arms} arms" if arms > 1 else ""
    return f"{where}: {naming.title} {rounded(number)} {naming.unit}{worst}{more}"


def _unpromised(points: Points, k: int) -> str:
    """Words for arms whose promise is broken or to which nothing is promised, with the premises that failed; "" where
    it holds for all."""
    arms, holding, broken = int(points.arms[k]), int(points.holding[k]), int(points.broken[k])
    if holding == arms:
        return ""
    if arms == 1:
        sentence = "; the promise is broken" if broken else "; nothing is promised"
    else:
        sentence = f"; the promise holds for {holding} of {arms} arms" + (
            f", and is broken for {broken}" if broken else ""
        )
    failed = ", ".join(STATEMENTS[Premise[name.upper()]].title for name in points.failed[k])
    return f"{sentence}; not met: {failed}" if failed else sentence


def _color(position: float) -> str:
    at = position * (len(STOPS) - 1)
    k = min(int(at), len(STOPS) - 2)
    r, g, b = (round(one + (at - k) * (other - one)) for one, other in zip(STOPS[k], STOPS[k + 1], strict=True))
    return f"rgb({r}, {g}, {b})"


def _cross(i: int, j: int, frame: _Frame) -> str:
    x, y, r = LEFT + (i + 0.5) * frame.wide, BOTTOM - (j + 0.5) * frame.tall, 0.22 * min(frame)
    return f"M {x - r:.1f} {y - r:.1f} l {2 * r:.1f} {2 * r:.1f} M {x - r:.1f} {y + r:.1f} l {2 * r:.1f} {-2 * r:.1f}"


def _ends(holds: Mapping[tuple[int, int], bool], frame: _Frame, look: str) -> str:
    """Line between tiles in which a property holds and tiles in which it does not, as SVG; "" where there is none.
    holds: whether the property holds, by column and row of the tile."""
    parts = []
    for (i, j), here in holds.items():
        x, y = LEFT + i * frame.wide, BOTTOM - j * frame.tall
        if holds.get((i + 1, j), here) != here:
            parts.append(f"M {x + frame.wide:.1f} {y:.1f} v {-frame.tall:.1f}")
        if holds.get((i, j + 1), here) != here:
            parts.append(f"M {x:.1f} {y - frame.tall:.1f} h {frame.wide:.1f}")
    return f'<path fill="none" pointer-events="none" {look} d="{" ".join(parts)}"/>' if parts else ""


def _place(axis: Axis, value: float | None) -> float | None:
    """Position of a value along an axis, in tiles; None beyond the axis' ends."""
    values = np.array(axis.values, dtype=float)
    if value is None or not values[0] <= value <= values[-1]:
        return None
    if axis.on_log_scale:
        value, values = math.log(value), np.log(values)
    return float(np.interp(value, values, np.arange(len(values)))) + 0.5


def _ring(plan: SweepPlan, present: Present) -> str:
    """Ring at the present values, as SVG; "" where they are not on the map."""
    x, y = plan.sweep.vary
    i, j = (_place(axis, present.get(axis.path)) for axis in (x, y))
    if i is None or j is None:
        return ""
    across, up = LEFT + i * (RIGHT - LEFT) / len(x.values), BOTTOM - j * (BOTTOM - TOP) / len(y.values)
    circle = f'cx="{across:.1f}" cy="{up:.1f}" r="6" fill="none" pointer-events="none"'
    return (
        f'<circle {circle} stroke="white" stroke-width="3"/>'
        f'<circle class="vs-present" {circle} stroke="black" stroke-width="1.2"/>'
    )


def _ticks_across(x: Axis, wide: float) -> list[str]:
    return [
        f'<text x="{LEFT + (k + 0.5) * wide:.1f}" y="{BOTTOM + 11}" text-anchor="middle">{label}</text>'
        for k, label in _labels(x)
    ]


def _labels(axis: Axis) -> list[tuple[int, str]]:
    """First, middle and last place of an axis with their numbers."""
    places = [0, len(axis.values) // 2, len(axis.values) - 1]
    return list(zip(places, in_one_style([float(axis.values[k]) for k in places]), strict=True))


def _ends_in_words(plan: SweepPlan, scale: ColorScale, naming: Naming) -> tuple[str, str, str]:
    """Low end, middle and high end of the scale of a map's numbers in words, without a unit; "" for the middle of a
    linear one."""
    if naming.share:
        return ("0", "", "1") if plan.sweep.draw else ("no", "", "yes")
    if not scale.logarithmic:
        low, high = in_one_style((scale.low, scale.high))
        return low, "", high
    low, middle, high = in_one_style((scale.low, math.sqrt(scale.low * scale.high), scale.high))
    return low, middle, high


def _ticks_up(plan: SweepPlan, scale: ColorScale, naming: Naming) -> list[str]:
    ends, share = _ends_in_words(plan, scale, naming)[::2], "share" if plan.sweep.draw else "limit kept"
    called = escape(share if naming.share else naming.unit or naming.title)
    return [
        *(
            f'<text x="{LEFT - 4}" y="{_up(position) + 4:.1f}" text-anchor="end">{end}</text>'
            for position, end in zip((0.0, 1.0), ends, strict=True)
        ),
        f'<text x="4" y="{BOTTOM + 23}">↑ {called}</text>',
    ]


def _ticks(x: Axis, y: Axis, frame: _Frame, naming: Naming) -> str:
    across, up = (f"{name}{f' [{unit}]' if unit else ''}" for name, unit in (naming.axes[x.path], naming.axes[y.path]))
    return "".join([
        *_ticks_across(x, frame.wide),
        *(
            f'<text x="{LEFT - 4}" y="{BOTTOM - (k + 0.5) * frame.tall + 4:.1f}" text-anchor="end">{label}</text>'
            for k, label in _labels(y)
        ),
        f'<text x="{RIGHT}" y="{BOTTOM + 23}" text-anchor="end">→ {escape(across)}</text>',
        f'<text x="4" y="{BOTTOM + 23}">↑ {escape(up)}</text>',
    ])  # fmt: skip


def _bar(plan: SweepPlan, scale: ColorScale, naming: Naming) -> str:
    """Meaning of the colours, as SVG."""
    if naming.share and not plan.sweep.draw:
        return "".join(
            f'<rect x="{at}" y="226" width="12" height="12" fill="{_color(end)}"/>'
            f'<text x="{at + 18}" y="236">{word}</text>'
            for at, end, word in ((LEFT, 0.0, "limit not kept"), ((LEFT + RIGHT) // 2, 1.0, "limit kept"))
        )
    step = (RIGHT - LEFT) / SHADES
    shades = "".join(
        f'<rect x="{LEFT + k * step:.1f}" y="226" width="{step + 0.5:.1f}" height="7" '
        f'fill="{_color(k / (SHADES - 1))}"/>'
        for k in range(SHADES)
    )
    words = _ends_in_words(plan, scale, naming)
    left, between, right = (f"{each} {naming.unit}" if each and not naming.share else each for each in words)
    middle = f'<text x="{(LEFT + RIGHT) / 2:.1f}" y="244" text-anchor="middle">{between}</text>' if between else ""
    return (
        f'{shades}<text x="{LEFT}" y="244">{left}</text>{middle}'
        f'<text x="{RIGHT}" y="244" text-anchor="end">{right}</text>'
    )
