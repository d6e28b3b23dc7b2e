"""Map of the tool's impedance over frequency, in decades: of the target model, and of the sampled loop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from app.dashboard.theme.colors import SERIES, css
from app.dashboard.widgets.equation import symbol
from app.export.response_files import told
from app.session.push_measurement import Measured
from app.simulation.push_response import PushResponse, along_axes, passive
from app.simulation.sampled_frequencies import LOWEST

_SIZE = (336, 172)
_LEFT, _RIGHT, _TOP, _BOTTOM = 34, 330, 18, 150  # px, edges of the frame
_POINTS = 70
_TALLEST = 6  # decades of impedance at most, upwards from the least


def impedance_html(response: PushResponse, points: Sequence[Measured] = (), measured: str = "") -> str:
    """Map of the impedance along each axis, as HTML: a dashed line for the target model, a solid one for the sampled
    loop, hatched where the loop is not passive, and dots of measured points; below it a description in words. Words
    alone where no push moves the tool.
    measured: words on the measured points."""
    frequency = response.frequencies(_POINTS)
    sampled, target = response.admittance(frequency), response.target(frequency)
    lines = [along_axes(sampled), along_axes(target)]
    said = "<br>".join(escape(line) for line in (*told(response), *([measured] if measured else [])))
    known = np.concatenate([line[np.isfinite(line)] for line in lines])
    if not known.size:
        return f'<div class="vs-checks"><div class="vs-note">A push on the tool:<br>{said}</div></div>'
    low = math.floor(math.log10(max(float(known.min()), 1e-3)) - 0.05)
    high = min(math.ceil(math.log10(max(float(known.max()), 1e-3)) + 0.05), low + _TALLEST)
    last = math.floor(math.log10(response.highest))
    parts = [
        *_hatched(frequency, passive(sampled), response),
        *(_upright(k, response) for k in range(math.ceil(math.log10(LOWEST)), last + 1)),
        *(_level(k, low, high) for k in range(low, high + 1)),
        *(
            f'<path fill="none" stroke="{css(SERIES[axis])}" stroke-width="{width}" {dash} d="{path}">'
            f"<title>{escape(what)} along {escape(name)}</title></path>"
            for what, line, width, dash in (
                ("target model", lines[1], 1.4, 'stroke-dasharray="5 4"'),
                ("sampled loop", lines[0], 2, ""),
            )
            for axis, name in enumerate(response.axes)
            if (path := _path(frequency, line[:, axis], low, high, response))
        ),
        *_dots(points, low, high, response),
        f'<text x="{_LEFT}" y="11">impedance [N·s/m]</text>',
        f'<text x="{_RIGHT}" y="{_SIZE[1] - 4}" text-anchor="end">f [Hz]</text>',
    ]
    legend = " ".join(
        f'<b style="color:{css(SERIES[axis])}">{symbol(name)}</b>' for axis, name in enumerate(response.axes)
    )
    return (
        '<div class="vs-checks"><div class="vs-note">A push on the tool meets, along '
        f"{legend}; dashed: the target model (8), solid: the sampled loop; hatched: a sine gets energy from it.</div>"
        f'<svg class="vs-poles" viewBox="0 0 {_SIZE[0]} {_SIZE[1]}" role="img" '
        f'aria-label="impedance over frequency">{"".join(parts)}</svg><div class="vs-note">{said}</div></div>'
    )


def _x(frequency: float, response: PushResponse) -> float:
    share = math.log(frequency / LOWEST) / math.log(response.highest / LOWEST)
    return _LEFT + (_RIGHT - _LEFT) * share


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


def _dots(points: Sequence[Measured], low: int, high: int, response: PushResponse) -> list[str]:
    """Dots of the measured points inside the frame, as SVG."""
    if not points:
        return []
    impedance = along_axes(np.array([point.admittance for point in points]))
    inside = np.isfinite(impedance) & (impedance <= 10.0**high) & (impedance >= 10.0**low)
    return [
        f'<circle class="measured" cx="{_x(points[k].frequency, response):.1f}" '
        f'cy="{_y(float(impedance[k, axis]), low, high):.1f}" r="2.6" fill="none" stroke="{css(SERIES[axis])}">'
        f"<title>measured along {escape(response.axes[axis])}: {impedance[k, axis]:.3g} N·s/m at "
        f"{points[k].frequency:.3g} Hz</title></circle>"
        for k, axis in np.argwhere(inside)
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


def _upright(k: int, response: PushResponse) -> str:
    x = _x(10.0**k, response)
    return (
        f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{_TOP}" y2="{_BOTTOM}"/>'
        f'<text x="{x:.1f}" y="{_BOTTOM + 13}" text-anchor="middle">{10.0**k:g}</text>'
    )


def _level(k: int, low: int, high: int) -> str:
    y = _y(10.0**k, low, high)
    label = f"{10.0**k:g}" if -2 <= k <= 4 else f'10<tspan dy="-4" font-size="8">{k}</tspan>'
    return (
        f'<line class="grid" x1="{_LEFT}" x2="{_RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>'
        f'<text x="{_LEFT - 4}" y="{y + 3.5:.1f}" text-anchor="end">{label}</text>'
    )
