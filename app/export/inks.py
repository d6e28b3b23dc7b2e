"""Inks: the colours of the dark page as they are printed on white paper, to be told apart in grey, too."""

from __future__ import annotations

import numpy as np

from app.export.figures import FigureChart, Rgb

Ink = tuple[float, float, float]  # a colour on paper, each part within 0 to 1
CONTRAST = 3.0  # least contrast with white, by WCAG 2 for graphics
DARKEST, LIGHTEST, STEP = 15.0, 60.7, 14.0  # lightness of a chart's lines; LIGHTEST has CONTRAST with white


def printed(color: Rgb) -> Ink:
    """Ink for a colour of the dark page, darkened until it has `CONTRAST` with white paper."""
    parts = np.array(color) / 255
    while 1.05 / (_luminance(parts) + 0.05) < CONTRAST:
        parts = parts * 0.98
    return _ink(parts)


def inks_of(chart: FigureChart) -> dict[Rgb, Ink]:
    """Inks of a chart by the colours of the page: of the same hues, and so different in lightness that they can be told
    apart in grey, too."""
    colors = list(dict.fromkeys(curve.color for curve in chart.curves if curve.width > 0 or curve.dotted))
    if len(colors) < 2:
        return {color: printed(color) for color in colors}
    own = {color: _luminance(np.array(color) / 255) for color in colors}
    steps = np.linspace(max(DARKEST, LIGHTEST - STEP * (len(colors) - 1)), LIGHTEST, len(colors))
    return {
        color: _with_luminance(color, _luminance_of(step))
        for color, step in zip(sorted(colors, key=own.__getitem__), steps, strict=True)
    }


def _luminance_of(lightness: float) -> float:
    """Luminance of CIE's lightness, 0 to 100, in which equal steps look equal."""
    return ((lightness + 16) / 116) ** 3


def _with_luminance(color: Rgb, luminance: float) -> Ink:
    """Ink of a colour that is darkened, or mixed with white, to a luminance, 0 to 1."""
    linear = _linear(np.array(color) / 255)
    scaled = linear * luminance / max(float(linear @ _WEIGHTS), 1e-9)
    clipped = scaled / max(float(scaled.max()), 1.0)
    below = float(clipped @ _WEIGHTS)
    white = (luminance - below) / (1.0 - below)
    mixed = np.clip(clipped + white * (1.0 - clipped), 0.0, 1.0)
    return _ink(np.where(mixed <= 0.0031308, 12.92 * mixed, 1.055 * mixed ** (1 / 2.4) - 0.055))


def _ink(parts: np.ndarray) -> Ink:
    r, g, b = np.clip(parts, 0.0, 1.0)
    return float(r), float(g), float(b)


_WEIGHTS = np.array([0.2126, 0.7152, 0.0722])


def _linear(parts: np.ndarray) -> np.ndarray:
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def _luminance(parts: np.ndarray) -> float:
    """Relative luminance, 0 to 1, of a colour's sRGB parts, by WCAG 2."""
    return float(_linear(parts) @ _WEIGHTS)
