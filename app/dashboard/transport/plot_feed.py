"""Feed of a chart's data, which sends only the points that the pages do not have yet.

While a run goes on a plot gains a few points at its right end and loses a few at its left; all others stay. Whole
arrays are sent when a page begins to show the chart, when the lines are others, and when no point stays.
`static/page/points.js` turns the arriving points into whole arrays, before viser's program sees them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import viser

from app.dashboard.transport.viser_private import further_points, is_with_all, whole_plot

TICK = 1e-6  # s: points nearer to each other are the same one


@dataclass(frozen=True)
class _Points:
    """Points of a chart: instants (N,) in ticks, and values (lines, N) in single precision."""

    at: np.ndarray
    values: np.ndarray

    def stay_until(self, later: _Points) -> int:
        """Number of points at the beginning of the later ones that are among these; 0 where the first one is not.

        The last of these points does not stay: it is the newest row, which another row has replaced."""
        begin = int(np.searchsorted(self.at, later.at[0]))
        count = min(len(self.at) - 1 - begin, len(later.at))
        if count <= 0 or self.at[begin] != later.at[0]:
            return 0
        old, new = self.values[:, begin : begin + count], later.values[:, :count]
        differs = ((old != new) & ~(np.isnan(old) & np.isnan(new))).any(axis=0)
        differs |= self.at[begin : begin + count] != later.at[:count]
        return int(differs.argmax()) if differs.any() else count


class PlotFeed:
    """Feed of one chart. most: number of its arrays, x included; unused ones are empty."""

    def __init__(self, chart: viser.GuiUplotHandle, most: int) -> None:
        self._chart, self._most = chart, most
        self._points: _Points | None = None  # points of the pages when all messages have come; None: send whole data
        self._mark = 0  # number of the whole data to which further points are added
        # numbers of messages of further points: of the last one, and of the last one that is certain to reach all pages
        self._number = self._after = 0
        self._message = -1  # viser's number of the last message of further points
        self._owed = np.inf  # ticks: pages may lack points from this instant on, those of messages after `_after`

    def forget(self) -> None:
        """Send whole data next time."""
        self._points = None

    def clear(self, nothing: np.ndarray) -> None:
        """Send data with these x (N,) and no lines."""
        self._send_whole((nothing,), nothing)
        self._points = None

    def send(self, now: float, x: np.ndarray, lines: Sequence[np.ndarray]) -> None:
        """Send the new points. x: (N,) s from now, increasing. lines: values (N,) each."""
        points = _Points(np.rint((now + x) / TICK).astype(np.int64), np.array(lines, dtype=np.float32))
        if stay := self._staying(points):
            self._send_further(stay, points, now)
        else:
            self._send_whole((x, *lines), points.at * TICK)
        self._points = points

    def _staying(self, points: _Points) -> int:
        """Number of points that every page has, or will have if no message overtakes another."""
        before = self._points
        if before is None or len(before.values) != len(points.values):
            return 0
        if is_with_all(self._chart, self._message):
            self._after, self._owed = self._number, np.inf
        return min(before.stay_until(points), int(np.searchsorted(points.at, self._owed)))

    def _send_whole(self, data: tuple[np.ndarray, ...], at: np.ndarray) -> None:
        self._mark += 1
        self._number, self._after, self._message, self._owed = 0, 0, -1, np.inf
        whole_plot(self._chart, data, self._most, {"mark": self._mark, "at": at})

    def _send_further(self, stay: int, points: _Points, now: float) -> None:
        self._number += 1
        self._owed = min(self._owed, points.at[min(stay, len(points.at) - 1)])
        further = {
            "mark": self._mark,
            "number": self._number,
            "after": self._after,
            "now": now,
            "begin": float(points.at[0]) * TICK,
            "stay": stay,
            "at": points.at[stay:] * TICK,
            "values": points.values[:, stay:],
        }
        self._message = further_points(self._chart, further)
