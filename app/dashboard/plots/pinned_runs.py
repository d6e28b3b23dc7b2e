"""Pinned runs in the plots of the page and on paper: their looks, and their signals in a stretch of the shown run.

Where a plot compares several lines, a pinned run's line has the colour of the shown run's and the dashes of its run: so
one reads which coordinate it is, and of which run; a grey entry of the legend tells the run's dashes. A single line has
the run's own colour, too, which is that of its arm in the scene.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.dashboard.plots.charts import ChartLine, Signals
from app.dashboard.theme.colors import RUN_DASHES, RUNS, Dashes, Rgb
from app.scenario.schema import Scenario
from app.scenario.units import Units
from app.session.snapshot import Snapshot
from app.session.timeline import Pinned
from app.simulation.recording import Recording
from app.simulation.signals import SIGNALS
from app.simulation.system import Coordinate

WIDTH = 1.3  # px
WIDER = 2.0  # times as wide are the gaps of a line that is dashed in the shown run

_GREY: Rgb = (140, 140, 140)
_ENTRY = ChartLine("", _GREY, lambda signals: np.full(len(signals["t"]), np.nan))


@dataclass(frozen=True)
class RunLook:
    """Look of a pinned run: its name in the legends, the colour of a single line, and the dashes of all, px."""

    name: str
    color: Rgb
    dashes: Dashes


@dataclass(frozen=True)
class PinnedChart:
    """Pinned run, drawn behind the shown run.
    units, coordinates: of its task space."""

    look: RunLook
    scenario: Scenario
    recording: Recording
    units: Units
    coordinates: tuple[Coordinate, ...]

    @classmethod
    def of(cls, run: Pinned) -> PinnedChart:
        look = RunLook(run.title, RUNS[run.slot], RUN_DASHES[run.slot])
        return cls(look, run.scenario, run.recording, run.system.units, tuple(run.system.coordinates))


def compared_lines(lines: Sequence[ChartLine]) -> list[ChartLine]:
    """Lines of a chart that are drawn of pinned runs, too; where there are several, a line without values comes first,
    for a run's entry in the legend."""
    compared = [line for line in lines if line.compared]
    return [_ENTRY, *compared] if len(compared) > 1 else compared


def lines_of_run(lines: Sequence[ChartLine], run: RunLook) -> list[ChartLine]:
    """`compared_lines` as they are drawn of a pinned run."""
    compared = compared_lines(lines)
    if len(compared) <= 1:
        return [_of_run(line, run, run.name, run.color, (line.name,)) for line in compared]
    entry, *several = compared
    names = tuple(line.name for line in several)
    return [
        _of_run(entry, run, run.name, entry.color, names),
        *(replace(_of_run(line, run, line.name, line.color, (line.name, run.name)), listed=False) for line in several),
    ]


def _of_run(line: ChartLine, run: RunLook, name: str, color: Rgb, repeats: tuple[str, ...]) -> ChartLine:
    wider = WIDER if line.dashed else 1.0
    dashes = tuple(wider * length if place % 2 else length for place, length in enumerate(run.dashes))
    return ChartLine(name, color, line.values, width=WIDTH, dashes=dashes, repeats=repeats)


def laid_on(pinned: PinnedChart, t_from: float, t_to: float, snapshot: Snapshot) -> Signals | None:
    """Signals of a pinned run in a stretch of the shown one, s; None for an arm with another number of joints. In a
    task space with other units nothing that is measured in them can be compared, in other coordinates none of their
    values."""
    if pinned.recording.n != snapshot.recording.n:
        return None
    of_r = [signal for signal in SIGNALS if signal.of in ("r", "J_q")]
    if pinned.units != snapshot.system.units:
        others = {signal.name for signal in of_r}
    elif pinned.coordinates != snapshot.coordinates:
        others = {signal.name for signal in of_r if signal.width is None}
    else:
        others = set[str]()
    return _Comparable(pinned.recording.stretch(t_from, t_to), others)


class _Comparable(Mapping[str, np.ndarray]):
    """Signals of a pinned run. others: those that are not the shown run's by the same names, and so are not known."""

    def __init__(self, signals: Signals, others: Collection[str]) -> None:
        self._signals, self._others = signals, others

    def __getitem__(self, name: str) -> np.ndarray:
        values = self._signals[name]
        return np.full_like(values, np.nan) if name in self._others else values

    def __iter__(self) -> Iterator[str]:
        return iter(self._signals)

    def __len__(self) -> int:
        return len(self._signals)
