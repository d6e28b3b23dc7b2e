"""Map of the tool's impedance over frequency, in decades: of the target model, and of the sampled loop."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from app.dashboard.theme.colors import SERIES, line_css
from app.dashboard.widgets.svg_grid import level, upright
from app.export.response_files import summary
from app.scenario.number_text import rounded
from app.session.push_measurement import Measured
from app.simulation.sampled_loop.push_response import PushKind, PushResponse, along_axes, passive
from app.simulation.sampled_loop.sampled_frequencies import LOWEST

_SIZE = (336, 172)
_LEFT, _RIGHT, _TOP, _BOTTOM = 34, 330, 18, 150  # px, edges of the frame
_POINTS = 70
_LEAST = 1e-3  # of an impedance that is drawn
_TALLEST = 6  # decades of impedance at most, upwards from the least
_ALIKE = 0.01  # decades within which two lines look like one


@dataclass(frozen=True)
class _Drawn:
    """Data of a response that a map draws.
    frequency: (N,) Hz.
    sampled, target: (N, p), impedance along each axis, of the sampled loop and of the target model.
    passive: (N,), whether no sinusoidal push gets energy from the arm.
    points: measured ones."""

    response: PushResponse
    frequency: np.ndarray
    sampled: np.ndarray
    target: np.ndarray
    passive: np.ndarray
    points: Sequence[Measured]


def impedance_html(response: PushResponse, points: Sequence[Measured] = (), measured: str = "") -> str:
    """Maps of the impedance along each axis to forces and to moments, as HTML: a dashed line for the target model, a
    solid one for the sampled loop, hatched where the loop is not passive, and dots of measured points; below them a
    description in words. Words alone where no push moves the tool.
    measured: words on the measured points."""
    frequency = response.frequencies(_POINTS)
    sampled, target = response.admittance(frequency), response.target(frequency)
    drawn = _Drawn(
        response, frequency, along_axes(frequency, sampled), along_axes(frequency, target), passive(sampled), points
    )
    maps = "".join(_map(drawn, push, axes) for push, axes in response.kinds.items())
    lines = "<br>".join(escape(line) for line in (*summary(response), *([measured] if measured else [])))
    if not maps:
        return f'<div class="vs-checks"><div class="vs-note">A push on the tool:<br>{lines}</div></div>'
    return (
        f'<div class="vs-checks">{maps}<div class="vs-note">Dashed: the target model (8), solid: the sampled loop; '
        f"hatched: there the loop gives energy to a sine.<br>{lines}</div></div>"
    )


def _map(drawn: _Drawn, push: PushKind, axes: Sequence[int]) -> str:
    """Map for pushes of one kind, "" where none of them moves the tool."""
    response = drawn.response
    known = np.concatenate([line[np.isfinite(line)] for line in (drawn.sampled[:, axes], drawn.target[:, axes])])
    if not known.size:
        return ""
    low = math.floor(math.log10(max(float(known.min()), _LEAST)) - 0.05)
    high = min(math.ceil(math.log10(max(float(known.max()), _LEAST)) + 0.05), low + _TALLEST)
    last = math.floor(math.log10(response.highest))
    alike = _alike(drawn, axes)
    words = {place: ", ".join(response.axes[axis].words for axis in alike[place]) for place in alike}
    paths = [
        (what, style, place, path)
        for what, line, style in (
            ("target model", drawn.target, 'stroke-width="1.4" stroke-dasharray="5 4"'),
            ("sampled loop", drawn.sampled, 'stroke-width="2"'),
        )
        for place in alike
        if (path := _path(drawn.frequency, line[:, axes[place]], low, high, response))
    ]
    parts = [
        *_hatched(drawn.frequency, drawn.passive, response),
        *(
            upright(_x(10.0**k, response), _TOP, _BOTTOM, f"{10.0**k:g}")
            for k in range(math.ceil(math.log10(LOWEST)), last + 1)
        ),
        *(_level(k, low, high) for k in range(low, high + 1)),
        *(
            f'<path fill="none" stroke="{line_css(SERIES[place])}" {style} d="{path}">'
            f"<title>{escape(f'{what} {words[place]}')}</title></path>"
            for what, style, place, path in paths
        ),
        *_dots(drawn, axes, alike, low, high),
        f'<text x="{_LEFT}" y="11">impedance [{push.impedance_unit}]</text>',
        f'<text x="{_RIGHT}" y="{_SIZE[1] - 4}" text-anchor="end">f [Hz]</text>',
    ]
    names = {place: " = ".join(response.axes[axis].words for axis in alike[place]) for place in alike}
    inside = {place for _, _, place, _ in paths}
    legend = ", ".join(
        f'<b style="color:{line_css(SERIES[place])}">{name}</b>' for place, name in names.items() if place in inside
    )
    if outside := ", ".join(name for place, name in names.items() if place not in inside):
        legend += f" (beyond the frame: {outside})"
    return (
        f'<div class="vs-note">Impedance to a {push.name} on the tool, {legend}:</div>'
        f'<svg class="vs-poles" viewBox="0 0 {_SIZE[0]} {_SIZE[1]}" role="img" '
        f'aria-label="impedance to {push.name}s over frequency">{"".join(parts)}</svg>'
    )


def _alike(drawn: _Drawn, axes: Sequence[int]) -> dict[int, list[int]]:
    """Axes whose lines look like one, by the place among `axes` of the first of them."""
    both = np.nan_to_num(np.stack([drawn.sampled[:, axes], drawn.target[:, axes]]), nan=_LEAST)
    lines = np.log10(np.fmax(both, _LEAST))
    alike: dict[int, list[int]] = {}
    for place, axis in enumerate(axes):
        first = next((k for k in alike if np.abs(lines[..., k] - lines[..., place]).max() < _ALIKE), place)
        alike.setdefault(first, []).append(axis)
    return alike


def _x(frequency: float, response: PushResponse) -> float:
    fraction = math.log(frequency / LOWEST) / math.log(response.highest / LOWEST)
    return _LEFT + (_RIGHT - _LEFT) * fraction


def _y(impedance: float, low: int, high: int) -> float:
    return _BOTTOM - (_BOTTOM - _TOP) * (math.log10(impedance) - low) / (high - low)


def _path(frequency: np.ndarray, impedance: np.ndarray, low: int, high: int, response: PushResponse) -> str:
    """Path of a line, as SVG; ends where the line leaves the frame."""
    inside = np.isfinite(impedance) & (impedance <= 10.0**high) & (impedance >= 10.0**low)
    path, pen = [], "M"
    for f, z, drawn in zip(frequency, impedance, inside, strict=True):
        if drawn:
            path.append(f"{pen} {_x(f, response):.1f} {_y(z, low, high):.1f}")
        pen = "L" if drawn else "M"
    return " ".join(path)


def _dots(drawn: _Drawn, axes: Sequence[int], alike: Mapping[int, list[int]], low: int, high: int) -> list[str]:
    """Dots of the measured points along these axes inside the frame, in the colours of their lines, as SVG."""
    points, response = drawn.points, drawn.response
    if not points:
        return []
    at = np.array([point.frequency for point in points])
    colours = {axis: line_css(SERIES[place]) for place, together in alike.items() for axis in together}
    impedance = along_axes(at, np.array([point.admittance for point in points]))[:, axes]
    inside = np.isfinite(impedance) & (impedance <= 10.0**high) & (impedance >= 10.0**low)
    return [
        f'<circle class="measured" cx="{_x(points[k].frequency, response):.1f}" '
        f'cy="{_y(float(impedance[k, place]), low, high):.1f}" r="2.6" fill="none" stroke="{colours[axes[place]]}">'
        f"<title>measured {escape(axis.words)}: {rounded(float(impedance[k, place]))} {axis.kind.impedance_unit} at "
        f"{rounded(points[k].frequency)} Hz</title></circle>"
        for k, place in np.argwhere(inside)
        for axis in [response.axes[axes[place]]]
    ]


def _hatched(frequency: np.ndarray, does: np.ndarray, response: PushResponse) -> list[str]:
    edges = np.flatnonzero(np.diff(np.concatenate([[True], does, [True]]).astype(int)))
    parts = []
    for first, after in edges.reshape(-1, 2):
        left, right = (_x(float(frequency[k]), response) for k in (first, after - 1))
        parts.append(
            f'<rect class="right" x="{left:.1f}" width="{max(right - left, 1.0):.1f}" y="{_TOP}" '
            f'height="{_BOTTOM - _TOP}"/>'
        )
    return parts


def _level(k: int, low: int, high: int) -> str:
    short = low >= -2 and high <= 4  # all labels in one style
    label = f"{10.0**k:g}" if short else f'10<tspan dy="-4" font-size="8">{k}</tspan>'
    return level(_y(10.0**k, low, high), _LEFT, _RIGHT, label)
