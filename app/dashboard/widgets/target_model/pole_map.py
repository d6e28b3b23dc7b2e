"""Map of the target model's poles: the distance from the centre shows omega, the angle zeta.

omega is shown in decades, because stiff and soft coordinates differ by thousands; only the half with Im >= 0 is drawn,
because the other half mirrors it.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from html import escape

import numpy as np

from app.scenario.number_text import counted, in_one_style, rounded

_R, _HOLE = 112.0, 14.0  # px: radius of the largest circle, and of the circle of the smallest decade
_X, _Y = 168.0, 128.0  # px: position of the origin
_SIZE = (336, 148)
_HATCH = (  # of the unstable half
    '<pattern id="vs-hatch" width="6" height="6" patternUnits="userSpaceOnUse">'
    '<path class="hatch" d="M 0 6 L 6 0"/></pattern>'
)
_DAMPING = (0.2, 0.5, 0.8)
_SAME = 1e-3  # relative distance below which poles are drawn as one: repeated ones are known to half the digits only


@dataclass(frozen=True)
class Pole:
    """Pole of the map. value: 1/s, with Im >= 0. count: multiplicity, that of its conjugate included."""

    value: complex
    count: int

    @property
    def omega(self) -> float:
        """Natural frequency, rad/s."""
        return abs(self.value)

    @property
    def zeta(self) -> float:
        """Damping ratio, 1; nan in the origin."""
        return -self.value.real / self.omega if self.omega else math.nan


def grouped(poles: np.ndarray) -> list[Pole]:
    """Poles of the map, by size: the poles (k,) 1/s of a real matrix, repeated and conjugate ones as one."""
    groups: list[list[complex]] = []
    for pole in sorted((complex(p.real, abs(p.imag)) for p in poles), key=lambda p: (abs(p), p.real)):
        near = next((g for g in groups if abs(g[0] - pole) <= _SAME * abs(pole)), None)
        if near is None:
            groups.append([pole])
        else:
            near.append(pole)
    return [Pole(complex(np.mean(group)), len(group)) for group in groups]


def pole_map_html(now: list[Pole], requested: list[Pole], dragged: Collection[int] = ()) -> str:
    """Map of poles as HTML. The page's script reads the frame's size from attributes.
    now: poles of the running model, drawn as crosses.
    requested: poles of the model that an edit asks for, drawn as rings.
    dragged: numbers of the poles that can be dragged."""
    low, high = _decades([*now, *requested])
    parts = [
        f'<path class="left" d="M {_X - _R} {_Y} A {_R} {_R} 0 0 1 {_X} {_Y - _R} V {_Y} Z"/>',
        f'<path class="right" d="M {_X + _R} {_Y} A {_R} {_R} 0 0 0 {_X} {_Y - _R} V {_Y} Z"/>',
        *(
            _circle(k, low, high, label)
            for k, label in zip(
                range(low, high + 1), in_one_style([10.0**k for k in range(low, high + 1)]), strict=True
            )
        ),
        *(_ray(zeta) for zeta in _DAMPING),
        f'<line class="axis" x1="{_X - _R - 10}" x2="{_X + _R + 10}" y1="{_Y}" y2="{_Y}"/>',
        f'<line class="axis" x1="{_X}" x2="{_X}" y1="{_Y}" y2="{_Y - _R - 8}"/>',
        f'<text x="4" y="12">stable</text><text x="{_SIZE[0] - 4}" y="12" text-anchor="end">unstable</text>',
        f'<text x="{_SIZE[0] - 4}" y="{_Y + 14}" text-anchor="end">ω [rad/s]</text>',
        *(_mark(pole, low, high, "now", k if k in dragged else None) for k, pole in enumerate(now)),
        *(_mark(pole, low, high, "asked") for pole in requested),
    ]
    return (
        f'<svg class="vs-poles" viewBox="0 0 {_SIZE[0]} {_SIZE[1]}" role="img" aria-label="pole map" data-x="{_X:g}" '
        f'data-y="{_Y:g}" data-hole="{_HOLE:g}" data-outer="{_R:g}" data-low="{low}" data-high="{high}">{_HATCH}'
        f"{''.join(parts)}</svg>"
    )


def _decades(poles: list[Pole]) -> tuple[int, int]:
    sizes = [pole.omega for pole in poles if pole.omega > 1e-9] or [1.0, 10.0]
    low = math.floor(math.log10(min(sizes)) - 0.1)
    return low, max(math.ceil(math.log10(max(sizes)) + 0.02), low + 1)


def _radius(omega: float, low: int, high: int) -> float:
    if omega <= 10.0**low:
        return _HOLE * omega / 10.0**low
    return _HOLE + (_R - _HOLE) * (math.log10(omega) - low) / (high - low)


def _place(pole: Pole, low: int, high: int) -> tuple[float, float]:
    if not pole.omega:
        return _X, _Y
    r = _radius(pole.omega, low, high) / pole.omega
    return _X + r * pole.value.real, _Y - r * pole.value.imag


def _circle(k: int, low: int, high: int, label: str) -> str:
    r = _radius(10.0**k, low, high)
    return (
        f'<path class="grid" d="M {_X - r:.1f} {_Y} A {r:.1f} {r:.1f} 0 0 1 {_X + r:.1f} {_Y}"/>'
        f'<text x="{_X - r:.1f}" y="{_Y + 14}" text-anchor="middle">{label}</text>'
    )


def _ray(zeta: float) -> str:
    x, y = -zeta, math.sqrt(1.0 - zeta**2)
    return (
        f'<line class="grid" x1="{_X}" y1="{_Y}" x2="{_X + _R * x:.1f}" y2="{_Y - _R * y:.1f}"/>'
        f'<text x="{_X + (_R + 4) * x:.1f}" y="{_Y - (_R + 4) * y:.1f}" text-anchor="end">ζ {zeta:g}</text>'
    )


def _mark(pole: Pole, low: int, high: int, look: str, number_of: int | None = None) -> str:
    x, y = _place(pole, low, high)
    imaginary = f" ± {rounded(pole.value.imag, 4)} j" if pole.value.imag > _SAME * pole.omega else ""
    swing = f"ω = {rounded(pole.omega, 4)} rad/s, ζ = {pole.zeta:.3g}"
    tip = f"{rounded(pole.value.real, 4)}{imaginary} 1/s, {swing}, {counted(pole.count, 'pole')}"
    shape = (
        f'<path d="M {x - 4.5:.1f} {y - 4.5:.1f} l 9 9 m 0 -9 l -9 9"/>'
        if look == "now"
        else f'<circle cx="{x:.1f}" cy="{y:.1f}" r="6"/>'
    )
    number = (
        f'<text x="{x:.1f}" y="{y - 8:.1f}" text-anchor="middle">{pole.count}×</text>'
        if pole.count > 2 and look == "now"
        else ""
    )
    if number_of is None:
        return f'<g class="{look}"><title>{escape(tip)}</title>{shape}{number}</g>'
    grip = f'<circle class="grip" cx="{x:.1f}" cy="{y:.1f}" r="11"/>'
    return f'<g class="{look}" data-pole="{number_of}"><title>{escape(tip)}; drag it</title>{grip}{shape}{number}</g>'
