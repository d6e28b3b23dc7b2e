"""Picture of a lesson's run: its lines, those of runs beside it, and the predictions; and axes to draw a curve on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from app.dashboard.theme.colors import MEASURED, Rgb, line_css
from app.dashboard.widgets.svg_grid import level, upright
from app.lessons.answers import Answer
from app.lessons.blocks import CurveQuestion, LessonRun, PictureLine
from app.lessons.lesson import LessonStep
from app.lessons.playing import Trace
from app.lessons.predictions import predicted
from app.lessons.words import ENGLISH, LessonWords
from app.scenario.number_text import plain

WIDTH, HEIGHT = 336, 168
LEFT, RIGHT, TOP, BOTTOM = 40, 330, 20, 140  # px, edges of the frame
TICKS = 4


def outcome_html(
    run: LessonStep,
    traces: Sequence[Trace],
    predictions: Sequence[tuple[LessonStep, Answer]],
    colors: Mapping[str, Rgb],
    words: LessonWords = ENGLISH,
) -> str:
    """Pictures of a run as HTML, one below the other for each line that it shows. colors: of the runs, by title."""
    block = run.block
    assert isinstance(block, LessonRun)
    pictures = []
    for line in block.show:
        of = [trace for trace in traces if trace.line.shows(line)]
        if of:
            pictures.append(_picture(block, line, of, predictions, colors, words))
    return "".join(pictures)


def pad_html(question: CurveQuestion, drawn: Sequence[tuple[float, float]] | None, words: LessonWords) -> str:
    """Axes on which a curve is drawn by mouse, finger or arrow keys, as HTML. drawn: points of the locked curve."""
    frame = _Frame(question.start, question.end, question.low, question.high)
    course = "" if drawn is None else _path(frame, np.array(drawn))
    ends = " ".join(
        f'data-{name}="{value:g}"'
        for name, value in (
            ("from", question.start),
            ("to", question.end),
            ("low", question.low),
            ("high", question.high),
        )
    )
    role = 'role="img"' if drawn is not None else 'tabindex="0" role="application"'
    label = words.draw.format(question.line.title)
    return (
        f'<div class="vs-pad" data-locked="{"" if drawn is None else "1"}">'
        f'<svg class="vs-poles" viewBox="0 0 {WIDTH} {HEIGHT}" {ends} data-left="{LEFT}" data-right="{RIGHT}" '
        f'data-top="{TOP}" data-bottom="{BOTTOM}" {role} aria-label="{escape(label)}">'
        f"{_grid(frame, f'{question.line.title} [{question.line.unit}]', words)}"
        f'<path class="vs-drawn" fill="none" stroke="{line_css(MEASURED)}" stroke-width="2.5" d="{course}"/>'
        f'<circle class="vs-pen" r="4" fill="{line_css(MEASURED)}" visibility="hidden"/></svg></div>'
    )


def courses_html(
    title: str, ends: tuple[float, float, float, float], courses: Sequence[np.ndarray], words: LessonWords
) -> str:
    """Picture of curves (N, 2) of t and value over each other, as HTML. ends: of the axes: start, end, low, high."""
    frame = _Frame(*ends)
    lines = "".join(
        f'<path fill="none" stroke="{line_css(MEASURED)}" stroke-width="1.5" opacity="0.45" '
        f'd="{_path(frame, course)}"/>'
        for course in courses
    )
    label = escape(words.as_predicted.format(title))
    return (
        f'<svg class="vs-poles" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}">'
        f"{_grid(frame, title, words)}{lines}</svg>"
    )


class _Frame:
    """Axes: t from `start` to `end` s, values from `low` to `high`."""

    def __init__(self, start: float, end: float, low: float, high: float) -> None:
        self.start, self.end, self.low, self.high = start, end, low, high

    def x(self, t: float) -> float:
        return LEFT + (RIGHT - LEFT) * (t - self.start) / (self.end - self.start)

    def y(self, value: float) -> float:
        return BOTTOM - (BOTTOM - TOP) * (value - self.low) / (self.high - self.low)


def _picture(
    run: LessonRun,
    line: PictureLine,
    traces: Sequence[Trace],
    predictions: Sequence[tuple[LessonStep, Answer]],
    colors: Mapping[str, Rgb],
    words: LessonWords,
) -> str:
    found = predicted(run, line, predictions)
    values = np.concatenate(
        [*(trace.values for trace in traces), *(drawn[:, 1] for drawn in found.courses), found.levels]
    )
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    room = 0.06 * (high - low) or 1.0
    frame = _Frame(0.0, max(float(trace.t[-1]) for trace in traces), low - room, high + room)
    parts = [_grid(frame, f"{line.title} [{line.unit}]", words)]
    legend = []
    for number, trace in enumerate(traces):
        last = number == len(traces) - 1
        color = colors[trace.run]
        parts.append(
            f'<path fill="none" stroke="{line_css(color)}" stroke-width="{2 if last else 1.2}" '
            f'd="{_path(frame, np.column_stack([trace.t, trace.values]))}"><title>{escape(trace.run)}</title></path>'
        )
        legend.append(
            f'<span><i class="vs-swatch" style="background: {line_css(color)}"></i>{escape(trace.run)}</span>'
        )
    parts += [_predicted(_path(frame, drawn), words) for drawn in found.courses]
    parts += [
        _predicted(f"M {LEFT} {frame.y(value):.1f} L {RIGHT} {frame.y(value):.1f}", words) for value in found.levels
    ]
    parts += [
        _predicted(f"M {frame.x(t):.1f} {TOP} L {frame.x(t):.1f} {BOTTOM}", words)
        for t in found.instants
        if frame.start <= t <= frame.end
    ]
    if found:
        legend.append(
            f'<span><i class="vs-swatch" style="background: {line_css(MEASURED)}"></i>{words.prediction}</span>'
        )
    label = escape(words.over_time.format(line.title))
    return (
        f'<svg class="vs-poles" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}">'
        f'{"".join(parts)}</svg><div class="vs-lines">{"".join(legend)}</div>'
    )


def _predicted(path: str, words: LessonWords) -> str:
    return (
        f'<path class="vs-predicted" fill="none" stroke="{line_css(MEASURED)}" stroke-width="2" stroke-dasharray="6 4" '
        f'd="{path}"><title>{words.prediction}</title></path>'
    )


def _path(frame: _Frame, points: np.ndarray) -> str:
    """Path through the points (N, 2) of t and value, broken where a value is not known."""
    path, pen = list[str](), "M"
    for t, value in points:
        if math.isnan(value):
            pen = "M"
            continue
        path.append(f"{pen} {frame.x(t):.1f} {min(max(frame.y(value), TOP), BOTTOM):.1f}")
        pen = "L"
    return " ".join(path)


def _grid(frame: _Frame, title: str, words: LessonWords) -> str:
    parts = [f'<text x="{LEFT}" y="12">{escape(title)}</text>']
    ticks, levels = _ticks(frame.start, frame.end), _ticks(frame.low, frame.high)
    parts += [upright(frame.x(t), TOP, BOTTOM, words.number(plain(t))) for t in ticks]
    parts += [level(frame.y(value), LEFT, RIGHT, words.number(plain(value))) for value in levels]
    parts.append(f'<text x="{RIGHT}" y="{HEIGHT - 3}" text-anchor="end">t [s]</text>')
    return "".join(parts)


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers between two ends, at least three."""
    rough = (high - low) / TICKS
    size = 10.0 ** math.floor(math.log10(rough))
    step = next(size * m for m in (1.0, 2.0, 2.5, 5.0, 10.0) if size * m >= rough * 0.8)
    first = math.ceil(low / step - 1e-9)
    return [float(f"{k * step:.6g}") + 0.0 for k in range(first, math.floor(high / step + 1e-9) + 1)]
