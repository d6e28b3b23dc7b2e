"""Trails in the scene: paths of moving points, in one colour or coloured by an error."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np
import viser

from app.dashboard.theme.colors import ERROR_COLORS, Rgb
from app.dashboard.view_options import rounded_up

PIECES, PIECE = 5, 50  # pieces of a path, and segments of a piece
SPACING = 0.002  # m
LEAST_ERROR = 1e-5  # m: the finest scale of the colours


def error_colors(errors: np.ndarray, largest: float) -> np.ndarray:
    """Colours (N, 3) of errors (N,) m on the scale from 0 to `largest` m."""
    palette = np.array(ERROR_COLORS, dtype=float)
    place = np.clip(errors / largest, 0.0, 1.0) * (len(palette) - 1)
    return np.stack([np.interp(place, np.arange(len(palette)), channel) for channel in palette.T], axis=1)


class Trail:
    """Trail of a moving point: a line through its last positions, in pieces, of which only the newest one changes and
    is sent again."""

    def __init__(self, scene: viser.SceneApi, name: str, color: Rgb, thickness: float) -> None:
        self._pieces = deque(_Piece(scene, f"{name}/{k}", color, thickness) for k in range(PIECES))

    def extend(self, point: np.ndarray, error_there: Callable[[], float] = float) -> None:
        """Extend the line to a point (3,) m with its error (m). Points that are not finite or hardly differ from the
        last one are left out."""
        newest = self._pieces[-1]
        if newest.points:
            moved = point - newest.points[-1]
            if moved @ moved <= SPACING**2:
                return
        error = error_there()
        if not (math.isfinite(error) and np.isfinite(point).all()):
            return
        if len(newest.points) > PIECE:
            end = newest.points[-1], newest.errors[-1]
            self._pieces.rotate(-1)
            newest = self._pieces[-1]
            newest.clear()
            newest.extend(*end)
        newest.extend(np.array(point), error)

    def clear(self) -> None:
        for piece in self._pieces:
            piece.clear()

    @property
    def scale(self) -> float:
        """Scale of the colours: a round number (m) above the largest error."""
        return rounded_up(max(piece.largest for piece in self._pieces), LEAST_ERROR)

    def draw(self, *, shown: bool, largest: float | None) -> None:
        """Send the new points to the pages. largest: error (m) of the last colour, None for one plain colour."""
        for piece in self._pieces:
            piece.draw(shown=shown, largest=largest)


class _Piece:
    """Piece of a trail: up to `PIECE` segments between points (3,) m, with an error (m) at each point.

    Its arrays always have the same length: points and colours reach the page in two messages, and must fit each other.
    """

    def __init__(self, scene: viser.SceneApi, name: str, color: Rgb, thickness: float) -> None:
        self._color = color
        self.points: list[np.ndarray] = []
        self.errors: list[float] = []
        self.largest = 0.0  # of the errors, m
        # a colour for each end from the beginning: a page draws a line white that had one colour when it came
        plain = np.tile(np.array(color, dtype=np.uint8), (PIECE, 2, 1))
        self._line = scene.add_line_segments(
            name, np.zeros((PIECE, 2, 3)), plain, thickness=thickness, thickness_units="screen", visible=False
        )
        self._changed = self._shown = False
        self._colored_to: float | None = None

    def extend(self, point: np.ndarray, error: float) -> None:
        self.points.append(point)
        self.errors.append(error)
        self.largest = max(self.largest, error)
        self._changed = True

    def clear(self) -> None:
        self.points.clear()
        self.errors.clear()
        self.largest = 0.0
        self._line.visible = self._shown = False

    def draw(self, *, shown: bool, largest: float | None) -> None:
        """See `Trail.draw`."""
        shown = shown and len(self.points) > 1
        if shown and (self._changed or largest != self._colored_to):
            points = np.array(self.points)
            self._line.points = _padded(np.stack([points[:-1], points[1:]], axis=1)).astype(np.float32)
            if largest is not None:
                colors = error_colors(np.array(self.errors), largest)
                self._line.colors = _padded(np.stack([colors[:-1], colors[1:]], axis=1)).astype(np.uint8)
            elif self._colored_to is not None:
                self._line.colors = np.tile(np.array(self._color, dtype=np.uint8), (PIECE, 2, 1))
            self._changed, self._colored_to = False, largest
        if shown != self._shown:
            self._line.visible = self._shown = shown


def _padded(segments: np.ndarray) -> np.ndarray:
    """Segments (PIECE, 2, 3): missing ones repeat the end of the last segment."""
    end = np.broadcast_to(segments[-1, 1], (PIECE - len(segments), 2, 3))
    return np.concatenate([segments, end])
