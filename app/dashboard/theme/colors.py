"""Colours of the page: one place, so that a quantity has the same colour in the scene, the plots and the text."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Rgb = tuple[int, int, int]
Dashes = tuple[float, ...]
Theme = Literal["dark", "light"]

ACCENT: Rgb = (66, 135, 245)
MEASURED: Rgb = (255, 153, 51)
DESIRED: Rgb = (64, 200, 110)
SURFACE: Rgb = (70, 140, 220)
SURFACE_LINES: Rgb = (110, 165, 225)
TOOL_PATH: Rgb = (255, 205, 90)
PUSH: Rgb = (204, 90, 190)
GHOST: Rgb = (120, 165, 240)
TIP: Rgb = (235, 60, 60)  # tool tip
MODEL: Rgb = (240, 128, 110)  # spring and damper of the target model
RUNS: tuple[Rgb, ...] = ((186, 145, 255), (120, 215, 215), (222, 184, 135))  # pinned runs, by their places
# The same, px of line and gap in turn: unlike each other, and unlike the dashes of the shown run's lines.
RUN_DASHES: tuple[Dashes, ...] = ((2.0, 3.0), (10.0, 3.0, 2.0, 3.0), (14.0, 5.0))
BOUND: Rgb = (235, 80, 80)
# viser derives shades of this colour; on a light page its links and buttons are two shades lighter
BRAND: dict[Theme, Rgb] = {"dark": ACCENT, "light": (14, 66, 160)}
GRID: dict[Theme, Rgb] = {"dark": (70, 74, 80), "light": (205, 210, 217)}
GRID_SECTION: dict[Theme, Rgb] = {"dark": (105, 110, 118), "light": (160, 167, 176)}

# From no error to the largest error: of medium lightness, visible on dark and on light, also to the colour-blind.
ERROR_COLORS: tuple[Rgb, ...] = ((60, 140, 235), (235, 165, 45), (215, 45, 75))

# One per task coordinate or joint, after Okabe and Ito; with the common colour deficiencies the first four are
# distinct, and so are the others, which are dashed. On a light page the script darkens them.
SERIES: tuple[Rgb, ...] = (
    (86, 180, 233),
    (230, 159, 0),
    (0, 190, 140),
    (240, 228, 66),
    (213, 94, 0),
    (204, 121, 167),
    (210, 210, 210),
)


_LINES: dict[Rgb, str] = {MEASURED: "measured", **{color: f"series-{k}" for k, color in enumerate(SERIES)}}


@dataclass(frozen=True)
class Ink:
    """Colours of a text and of the ground below it, which is the page's colour with a share of a tint."""

    text: Rgb
    tint: Rgb
    opacity: float

    def ground(self, page: Rgb) -> Rgb:
        """Colour of the ground on a page of this colour."""
        r, g, b = (
            round(self.opacity * tint + (1 - self.opacity) * plain) for tint, plain in zip(self.tint, page, strict=True)
        )
        return r, g, b


PAGE: dict[Theme, Rgb] = {"dark": (36, 36, 36), "light": (255, 255, 255)}  # as viser has it
SKY: dict[Theme, Rgb] = {"dark": (20, 20, 20), "light": (240, 243, 247)}
LINE: dict[Theme, Rgb] = {"dark": (52, 52, 52), "light": (228, 230, 233)}
EDGE: dict[Theme, Rgb] = {"dark": (120, 120, 120), "light": (130, 134, 140)}
INKS: dict[Theme, dict[str, Ink]] = {
    "dark": {
        "mode": Ink((156, 195, 255), ACCENT, 0.25),
        "good": Ink((75, 210, 120), DESIRED, 0.2),
        "warn": Ink((255, 160, 65), MEASURED, 0.2),
        "bad": Ink((255, 143, 143), BOUND, 0.25),
        "dim": Ink((165, 165, 165), PAGE["dark"], 0.0),
    },
    "light": {
        "mode": Ink((18, 72, 160), ACCENT, 0.16),
        "good": Ink((10, 92, 45), DESIRED, 0.2),
        "warn": Ink((132, 66, 0), MEASURED, 0.2),
        "bad": Ink((160, 24, 24), BOUND, 0.16),
        "dim": Ink((92, 95, 100), PAGE["light"], 0.0),
    },
}


def css(color: Rgb, alpha: float = 1.0) -> str:
    """The colour as CSS writes it."""
    return f"rgba({color[0]}, {color[1]}, {color[2]}, {alpha:g})"


def on_white(color: Rgb) -> Rgb:
    """Colour of a line on the light page, as plots.js darkens it: at least 3:1 with white, and the lightest colours
    become the darkest, so that they stay apart."""
    light = [(part / 255) ** 2.2 for part in color]
    luminance = 0.2126 * light[0] + 0.7152 * light[1] + 0.0722 * light[2]
    factor = 1.0 if luminance <= 0.28 else (0.28 - 0.35 * (luminance - 0.28)) / luminance
    r, g, b = (round(255 * (factor * part) ** (1 / 2.2)) for part in light)
    return r, g, b


def line_css(color: Rgb) -> str:
    """Variable of a line's colour in both themes, as CSS writes it: of MEASURED or one of SERIES."""
    return f"var(--vs-{_LINES[color]})"


def css_variables() -> str:
    """The page's colours in both themes, as the variables --vs-… that the style sheet uses."""
    return "".join(f'[data-mantine-color-scheme="{theme}"] {{ {_variables(theme)} }}\n' for theme in ("dark", "light"))


def _variables(theme: Theme) -> str:
    plain = {"accent": ACCENT, "push": PUSH, "sky": SKY[theme], "line": LINE[theme], "edge": EDGE[theme]}
    colors = {name: css(color) for name, color in plain.items()}
    for color, name in _LINES.items():
        colors[name] = css(color if theme == "dark" else on_white(color))
    for name, ink in INKS[theme].items():
        colors[name] = css(ink.text)
        colors[f"{name}-ground"] = css(ink.tint, ink.opacity)
    return " ".join(f"--vs-{name}: {color};" for name, color in colors.items())
