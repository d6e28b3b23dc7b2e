"""Spring and damper of the target model (8), drawn between the desired point and the tool."""

from __future__ import annotations

import numpy as np
import viser

from app.dashboard.theme.colors import MODEL
from app.dashboard.transport.viser_private import draw_points

WINDINGS = 6
HALF_WIDTH = 0.014  # m, from the drawing's middle to the spring's axis, and to the damper's axis
BESIDE = 0.08  # m, from the tool to the drawing's middle: nearer to the tool the arm would hide it
SHORTEST = 0.006  # m: a shorter drawing is too small to be seen
_LEVEL, _UP = np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


def outline() -> np.ndarray:
    """Segments (N, 2, 2) of the drawing: the first coordinate goes along the deflection, as a share of it from 0 to 1,
    the second across, in half widths."""
    turns = 0.2 + 0.6 * (np.arange(2 * WINDINGS) + 0.5) / (2 * WINDINGS)
    zigzag = np.stack([turns, 1.0 + 0.5 * (-1.0) ** np.arange(2 * WINDINGS)], axis=1)
    spring = np.array([(0.0, 1.0), (0.2, 1.0), *zigzag, (0.8, 1.0), (1.0, 1.0)])
    rod, piston = [(0.0, -1.0), (0.5, -1.0)], [(0.5, -1.4), (0.5, -0.6)]
    cup = [(0.35, -1.6), (0.7, -1.6), (0.7, -0.4), (0.35, -0.4)]
    stem, bars = [(0.7, -1.0), (1.0, -1.0)], ([(0.0, -1.0), (0.0, 1.0)], [(1.0, -1.0), (1.0, 1.0)])
    paths = (spring, rod, piston, cup, stem, *bars)
    return np.concatenate([np.stack([np.array(path)[:-1], np.array(path)[1:]], axis=1) for path in paths])


_OUTLINE = outline()


def segments(tool: np.ndarray, desired: np.ndarray, times: float) -> np.ndarray:
    """Segments (N, 2, 3) m of the drawing, on the outer side of the tool; the last one leads to it from the tool.
    tool, desired: points (3,) m. times: length of the drawing over the tool's deflection from the desired point."""
    along = times * (desired - tool)
    outwards = _LEVEL * tool
    aside = outwards - (outwards @ along) / (along @ along) * along
    if np.linalg.norm(aside) < 1e-3:
        aside = np.cross(along, _UP)
    aside /= np.linalg.norm(aside)
    drawn = tool + _OUTLINE[..., :1] * along + (BESIDE + HALF_WIDTH * _OUTLINE[..., 1:]) * aside
    return np.concatenate([drawn, [[tool, tool + (BESIDE - HALF_WIDTH) * aside]]])


class SpringDamper:
    """Drawing of the spring and the damper; hidden where it would be too short to be seen."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._lines = scene.add_line_segments(
            name, np.zeros((len(_OUTLINE) + 1, 2, 3)), MODEL, thickness=2.0, thickness_units="screen", visible=False
        )

    def show(self, tool: np.ndarray, desired: np.ndarray | None, times: float) -> None:
        """Draw spring and damper. tool: (3,) m. desired: point (3,) m, None to hide them. times: see `segments`."""
        length = 0.0 if desired is None else times * float(np.linalg.norm(desired - tool))
        visible = SHORTEST < length < np.inf
        if visible and desired is not None:
            draw_points(self._lines, segments(tool, desired, times))
        self._lines.visible = visible

    def hide(self) -> None:
        self._lines.visible = False
