"""Paths in the scene: the last points of a moving point, plain or coloured by an error."""

from __future__ import annotations

from collections import deque

import numpy as np
import viser

from app.dashboard.theme.colors import ERROR_COLORS, Rgb
from app.dashboard.view_options import rounded_up

LENGTH = 500  # points
SPACING = 0.001  # m
LEAST_ERROR = 1e-5  # m: the finest scale of the colours


def error_colors(errors: np.ndarray, largest: float) -> np.ndarray:
    """Colours (N, 3) of errors (N,) m on the scale from 0 to `largest` m."""
    palette = np.array(ERROR_COLORS, dtype=float)
    place = np.clip(errors / largest, 0.0, 1.0) * (len(palette) - 1)
    return np.stack([np.interp(place, np.arange(len(palette)), channel) for channel in palette.T], axis=1)


class Trail:
    """The line through the last points.

    Its arrays always have the same length, so that points and colours never differ in it on their way to the page.
    """

    def __init__(self, scene: viser.SceneApi, name: str, color: Rgb, thickness: float) -> None:
        self._color = color
        self._points: deque[np.ndarray] = deque(maxlen=LENGTH)
        self._errors: deque[float] = deque(maxlen=LENGTH)
        self._line = scene.add_line_segments(
            name, np.zeros((LENGTH - 1, 2, 3)), color, thickness=thickness, thickness_units="screen", visible=False
        )
        self._changed = False
        self._colored_to: float | None = None

    def extend(self, point: np.ndarray, error: float = 0.0) -> None:
        """Extend the line to a point (3,) m with this error (m), unless the point is not finite or hardly differs from
        the last one."""
        if not np.isfinite([*point, error]).all():
            return
        if not self._points or np.linalg.norm(point - self._points[-1]) > SPACING:
            self._points.append(np.array(point))
            self._errors.append(error)
            self._changed = True

    def clear(self) -> None:
        self._points.clear()
        self._errors.clear()
        self._line.visible = False

    @property
    def scale(self) -> float:
        """Round number (m) above the largest error."""
        return rounded_up(max(self._errors, default=0.0), LEAST_ERROR)

    def draw(self, shown: bool, largest: float | None) -> None:
        """Send what is new. largest: the error (m) of the last colour, None for one plain colour."""
        shown = shown and len(self._points) > 1
        if shown and (self._changed or largest != self._colored_to):
            points = np.array(self._points)
            self._line.points = _padded(np.stack([points[:-1], points[1:]], axis=1)).astype(np.float32)
            if largest is not None:
                colors = error_colors(np.array(self._errors), largest)
                self._line.colors = _padded(np.stack([colors[:-1], colors[1:]], axis=1)).astype(np.uint8)
            elif self._colored_to is not None:
                self._line.colors = np.tile(np.array(self._color, dtype=np.uint8), (LENGTH - 1, 2, 1))
            self._changed, self._colored_to = False, largest
        self._line.visible = shown


def _padded(segments: np.ndarray) -> np.ndarray:
    """Segments (LENGTH - 1, 2, 3): missing ones repeat the end of the last segment."""
    end = np.broadcast_to(segments[-1, 1], (LENGTH - 1 - len(segments), 2, 3))
    return np.concatenate([segments, end])
