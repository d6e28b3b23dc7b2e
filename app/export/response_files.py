"""Files of a response to a push and of the force loop: their figure, their tables, and a summary in a few lines."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import cycle, pairwise
from typing import NamedTuple

import numpy as np

from app.export.figures import FREQUENCY, Curve, Figure, FigureChart, Rgb
from app.session.push_measurement import Measured
from app.simulation.sampled_loop.force_margin import ForceLoop
from app.simulation.sampled_loop.push_response import (
    RIGID,
    ROUNDING_ADMITTANCE,
    PushAxis,
    PushResponse,
    along_axes,
    block,
    largest_and_smallest,
    passive,
)
from app.simulation.sampled_loop.sampled_stability import RespondingLoop

BLUE, ORANGE, GREEN, GREY = (86, 180, 233), (230, 159, 0), (0, 158, 115), (140, 140, 140)
NEAR = 0.1  # share of the target's impedance within which the sampled loop counts as following it
STEP = 2.0  # s, length of the response to a step


def figure_of(loop: RespondingLoop, response: PushResponse, points: Sequence[Measured], caption: str) -> Figure:
    """Figure of a response: the impedance along each axis and over all directions, for forces and for moments, the way
    under a step, the poles, and gain and phase of the force loop where there is one. points: measured ones."""
    frequency = response.frequencies()
    sampled, target = response.admittance(frequency), response.target(frequency)
    z_sampled, z_target = along_axes(frequency, sampled), along_axes(frequency, target)
    at = np.array([point.frequency for point in points])
    of_points = [point.admittance for point in points]
    dots = along_axes(at, np.array(of_points)) if points else np.empty((0, len(response.axes)))
    charts = [
        _chart(
            f"impedance {axis.words}",
            axis.kind.impedance_unit,
            [
                _line("target model (8)", ORANGE, frequency, z_target[:, k], dashed=True),
                _line("sampled loop", BLUE, frequency, z_sampled[:, k]),
                *_dots(at, dots[:, k]),
            ],
        )
        for k, axis in enumerate(response.axes)
    ]
    for push, axes in response.kinds.items():
        extremes, wanted = (largest_and_smallest(frequency, block(each, axes)) for each in (sampled, target))
        charts.append(
            _chart(
                f"impedance to {push.name}s, over all directions",
                push.impedance_unit,
                [
                    *_pair("target model (8)", ORANGE, frequency, wanted, dashed=True),
                    *_pair("sampled loop", BLUE, frequency, extremes),
                ],
            )
        )
    charts += _of_steps(response)
    poles = (
        Curve("target model (8)", ORANGE, np.real(loop.model), np.imag(loop.model), width=0.0, dotted=True),
        Curve("sampled loop", BLUE, np.real(loop.sampled), np.imag(loop.sampled), width=0.0, dotted=True),
    )
    charts.append(FigureChart("poles, imaginary over real part", "1/s", poles, x_label="real part [1/s]"))
    if loop.force_loop is not None:
        charts += _of_force_loop(loop.force_loop)
    return Figure(tuple(chart for chart in charts if chart.curves), caption, one_column=1)


def _of_steps(response: PushResponse) -> list[FigureChart]:
    """Charts of the tool's way along each axis under a unit push from t = 0 on, but for axes along which it does not
    move."""
    times, ways, wished = response.step(STEP)
    charts = []
    for axis, way, wish in zip(response.axes, ways.T, wished.T, strict=True):
        if max(np.abs(way).max(), np.abs(wish).max()) > RIGID:
            curves = (
                Curve("target model (8)", ORANGE, times, 1e3 * wish, dashed=True),
                Curve("sampled loop", BLUE, times, 1e3 * way),
            )
            title = f"{axis.kind.motion} {axis.words} under a step of 1 {axis.kind.unit}"
            charts.append(FigureChart(title, f"m{axis.kind.motion_unit}", curves))
    return charts


def _of_force_loop(loop: ForceLoop) -> list[FigureChart]:
    """Charts of gain and phase of the opened force loop over frequency, with lines at the limits of stability."""
    opened = _opened(loop)
    frequency, ends = opened.frequency, opened.frequency[[0, -1]]
    gain, phase = [], []
    for name, size, angle, color in zip(
        opened.names, opened.gain.T, opened.phase.T, cycle((BLUE, ORANGE, GREEN)), strict=False
    ):
        gain.append(Curve(f"loop gain{name}", color, frequency, size))
        phase.append(Curve(f"phase{name}", color, frequency, angle))
    gain.append(Curve("1", GREY, ends, np.ones(2), dashed=True))
    phase.append(Curve("−180°", GREY, ends, np.full(2, -180.0), dashed=True))
    return [
        FigureChart("force loop, opened at its reading", "1", tuple(gain), x_label=FREQUENCY, logarithmic=True,
              logarithmic_x=True),
        FigureChart("phase of the force loop", "°", tuple(phase), x_label=FREQUENCY, logarithmic_x=True),
    ]  # fmt: skip


class _Opened(NamedTuple):
    """Opened force loop with the sign of text books: its limit of stability is −1, not 1.
    frequency: (N,) Hz.
    gain: (N, p).
    phase: (N, p) degrees.
    names: of the p curves, "" where p = 1."""

    frequency: np.ndarray
    gain: np.ndarray
    phase: np.ndarray
    names: tuple[str, ...]


def _opened(loop: ForceLoop) -> _Opened:
    frequency = loop.frequencies()
    gains = followed(-loop.gains(frequency))
    p = gains.shape[1]
    names = ("",) if p == 1 else tuple(f" {k + 1}" for k in range(p))
    return _Opened(frequency, np.abs(gains), np.degrees(np.unwrap(np.angle(gains), axis=0)), names)


def followed(values: np.ndarray) -> np.ndarray:
    """Curves through unordered values (N, p): each row is put into the order in which each column goes on from its
    value in the row before, so that curves that cross do not change places."""
    from scipy.optimize import linear_sum_assignment  # takes 0.1 s, which no other command waits for

    found = values.copy()
    for before, row in pairwise(found):
        sizes = np.abs(before)[:, None] + np.abs(row)
        apart = np.abs(row - before[:, None]) / np.maximum(sizes, np.finfo(float).tiny)
        row[:] = row[linear_sum_assignment(np.nan_to_num(apart, nan=1.0, posinf=1.0))[1]]
    return found


def force_table_of(loop: ForceLoop) -> str:
    """CSV of gain and phase of the opened force loop."""
    opened = _opened(loop)
    file = io.StringIO()
    rows = csv.writer(file, lineterminator="\n")
    heads = (f"{what}{name}" for name in opened.names for what in ("gain [1]", "phase [deg]"))
    rows.writerow(["frequency [Hz]", *heads])
    for at, gain, phase in zip(opened.frequency, opened.gain, opened.phase, strict=True):
        rows.writerow([f"{value:.6g}" for value in (at, *np.column_stack([gain, phase]).ravel())])
    return file.getvalue()


def _line(name: str, color: Rgb, frequency: np.ndarray, impedance: np.ndarray, *, dashed: bool = False) -> Curve:
    finite = np.isfinite(impedance)
    return Curve(name, color, frequency[finite], impedance[finite], dashed=dashed, listed=bool(finite.any()))


def _pair(name: str, color: Rgb, frequency: np.ndarray, values: np.ndarray, *, dashed: bool = False) -> list[Curve]:
    """Curves of the largest and the smallest impedance, values (N, 2), under one name: the latter alone, and named so,
    where the arm does not yield in some direction."""
    largest, smallest = (_line("", color, frequency, each, dashed=dashed) for each in values.T)
    if not len(largest.x):
        return [replace(smallest, name=f"{name}, smallest")]
    return [replace(largest, name=f"{name}, largest and smallest"), replace(smallest, listed=False)]


def _dots(frequency: np.ndarray, impedance: np.ndarray) -> list[Curve]:
    """Curves of dots for measured points, none where the tool does not yield."""
    finite = np.isfinite(impedance)
    return (
        [Curve("measured", GREY, frequency[finite], impedance[finite], width=0.0, dotted=True)] if finite.any() else []
    )


def _chart(title: str, unit: str, curves: list[Curve]) -> FigureChart:
    drawn = tuple(curve for curve in curves if len(curve.x))
    return FigureChart(title, unit, drawn, x_label=FREQUENCY, logarithmic=True, logarithmic_x=True)


def table_of(response: PushResponse, points: Sequence[Measured]) -> str:
    """CSV of a response: the impedance and its phase along each axis, its extremes over all directions, and passivity;
    then the measured points."""
    frequency = response.frequencies()
    file = io.StringIO()
    rows = csv.writer(file, lineterminator="\n")
    alongs = [
        f"{what} {axis.words}"
        for axis in response.axes
        for what in (f"impedance [{axis.kind.impedance_unit}]", "phase [deg]")
    ]
    extremes = [f"{which} [{push.impedance_unit}]" for push in response.kinds for which in ("largest", "smallest")]
    rows.writerow(["kind", "frequency [Hz]", *alongs, *extremes, "passive"])
    of_points = (np.array([p.frequency for p in points]), np.array([p.admittance for p in points]))
    kinds = {
        "target": (frequency, response.target(frequency)),
        "sampled": (frequency, response.admittance(frequency)),
        **({"measured": of_points} if points else {}),
    }
    for kind, (at, admittance) in kinds.items():
        rows.writerows([kind, *line] for line in _lines(response, at, admittance))
    return file.getvalue()


def _lines(response: PushResponse, frequency: np.ndarray, admittance: np.ndarray) -> Iterator[list[str]]:
    impedance, phase = along_axes(frequency, admittance), -np.angle(np.diagonal(admittance, axis1=1, axis2=2), deg=True)
    blocks = [block(admittance, axes) for axes in response.kinds.values()]
    extremes = np.hstack([largest_and_smallest(frequency, each) for each in blocks])
    does = passive(admittance)
    for k, at in enumerate(frequency):
        pairs = np.column_stack([impedance[k], phase[k]]).ravel()
        yield [f"{at:.6g}", *(f"{value:.6g}" for value in (*pairs, *extremes[k])), "yes" if does[k] else "no"]


def summary(response: PushResponse) -> list[str]:
    """Summary of a response in lines: how far it follows the target model, and where it is passive."""
    frequency = response.frequencies()
    sampled, target = response.admittance(frequency), response.target(frequency)
    alike: dict[str, list[str]] = {}
    for k, axis in enumerate(response.axes):
        alike.setdefault(_followed(axis, frequency, sampled[:, k, k], target[:, k, k]), []).append(axis.words)
    axes = [f"{', '.join(words)}: {does}" for does, words in alike.items()]
    moves = np.abs(sampled / (2 * np.pi * frequency[:, None, None])).max() > RIGID
    return [*axes, _passive(response, frequency, sampled)] if moves else axes


def _passive(response: PushResponse, frequency: np.ndarray, sampled: np.ndarray) -> str:
    """Ranges in which the sampled loop is passive, in words: to all pushes, and to those of one kind alone."""
    together = f"passive {_ranges(frequency, passive(sampled))}"
    if len(response.kinds) == 1:
        return together
    alone = (
        f"to {push.name}s alone {_ranges(frequency, passive(block(sampled, axes)))}"
        for push, axes in response.kinds.items()
    )
    return f"{together}; {', '.join(alone)}"


def _followed(axis: PushAxis, frequency: np.ndarray, sampled: np.ndarray, target: np.ndarray) -> str:
    push = axis.kind
    if not np.abs(target).max() > ROUNDING_ADMITTANCE:
        largest = np.abs(sampled / (2 * np.pi * frequency)).max()
        yields = f"yields by {1e6 * largest:.3g} µ{push.motion_unit} per {push.unit} at most"
        return f"the target model feels no {push.name}, and the arm {yields if largest > RIGID else 'does not yield'}"
    near = np.abs(target / sampled - 1.0) <= NEAR
    return f"within {NEAR:.0%} of the target's impedance {_ranges(frequency, near)}"


def _ranges(frequency: np.ndarray, does: np.ndarray) -> str:
    """Ranges of the frequency in which a property holds, in words. frequency: (N,) Hz. does: (N,), whether it holds."""
    if does.all():
        return "at all frequencies that samples can tell"
    edges = np.flatnonzero(np.diff(np.concatenate([[False], does, [False]]).astype(int)))
    ranges = [(frequency[first], frequency[last - 1]) for first, last in edges.reshape(-1, 2)]
    texts = [f"{'' if low == frequency[0] else f'from {low:.3g} '}up to {high:.3g} Hz" for low, high in ranges]
    return " and ".join(texts) if texts else "nowhere"
