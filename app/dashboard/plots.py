"""The plots: each names the signals it needs and turns them into lines; one read of the recording feeds them all.

Ahead of now stands the preview, when there is one: the same lines from the preview's signals. The page's script makes
lighter whatever lies right of zero.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import viser
from viser import uplot

from app.dashboard.equation import symbol
from app.dashboard.theme import BOUND, DESIRED, MEASURED, SERIES, Rgb, css
from app.preview import Outlook
from app.runner import Snapshot

WINDOW = 8.0  # s
POINTS = 320  # about what a plot has pixels for
_FLOOR = 1e-2  # mm/s: what a logarithmic axis shows of an exact zero
_EMPTY = np.array([-WINDOW, 0.0])

Signals = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Line:
    """One line: its name, its look, and its values from the recording's signals."""

    name: str
    color: Rgb
    values: Callable[[Signals], np.ndarray]
    dashed: bool = False
    width: float = 1.6

    def series(self) -> uplot.Series:
        look = uplot.Series(label=self.name, stroke=css(self.color), width=self.width, points={"show": False})
        if self.dashed:
            look["dash"] = (6.0, 4.0)
        return look


@dataclass(frozen=True)
class Plot:
    """A chart: title with unit, the signals it reads, its lines for the coordinates of a run."""

    title: str
    signals: tuple[str, ...]
    lines: Callable[[Snapshot], list[Line]]
    logarithmic: bool = False
    at_least: tuple[float, float] | None = None  # this range is always in view, so that noise does not fill the plot

    def y_scale(self) -> uplot.Scale:
        if self.logarithmic:
            return uplot.Scale(distr=3)
        if self.at_least is None:
            return uplot.Scale()
        low, high = ({"pad": 0.1, "soft": soft, "mode": 1} for soft in self.at_least)
        return uplot.Scale(range={"min": low, "max": high})


def _column(signal: str, index: int, factor: float = 1.0) -> Callable[[Signals], np.ndarray]:
    return lambda signals: factor * signals[signal].reshape(len(signals["t"]), -1)[:, index]


def _total(*names: str, factor: float = 1.0) -> Callable[[Signals], np.ndarray]:
    def total(signals: Signals) -> np.ndarray:
        columns = [signals[name].reshape(len(signals["t"]), -1).sum(axis=1) for name in names]
        return factor * np.sum(columns, axis=0)

    return total


def _per_coordinate(signal: str, factor: float = 1.0) -> Callable[[Snapshot], list[Line]]:
    def lines(snapshot: Snapshot) -> list[Line]:
        return [
            Line(symbol(coordinate.name), SERIES[i % len(SERIES)], _column(signal, i, factor))
            for i, coordinate in enumerate(snapshot.coordinates)
        ]

    return lines


def _forces(snapshot: Snapshot) -> list[Line]:
    if snapshot.coordinates[0].name != "φ":  # no normal direction in this task space
        return [Line(f"F {axis}", SERIES[i], _column("F", i)) for i, axis in enumerate("xyz")]
    return [
        Line("desired normal", DESIRED, _column("F_cd", 0), dashed=True, width=2.0),
        Line("measured normal", MEASURED, _column("F_c", 0)),
    ]


def _sliding(_: Snapshot) -> list[Line]:
    return [
        Line("bound (20) + sampling", BOUND, _total("s_bound", "s_band", factor=1e3), dashed=True, width=2.0),
        Line("‖s‖", SERIES[0], _total("s_norm", factor=1e3)),
    ]


def _guarantee(_: Snapshot) -> list[Line]:
    return [
        Line("needed (17)", BOUND, _total("d_required"), dashed=True, width=2.0),
        Line("d", DESIRED, _total("d")),
    ]


def _torques(snapshot: Snapshot) -> list[Line]:
    return [
        Line(f"τ{symbol(f'_{i + 1}')}", SERIES[i % len(SERIES)], _column("tau", i))
        for i in range(len(snapshot.robot.joint_names))
    ]


TABS: dict[str, tuple[Plot, ...]] = {
    "Live": (
        Plot("tracking error  e_r  [mm]", ("e_r",), _per_coordinate("e_r", 1000.0), at_least=(-0.01, 0.01)),
        Plot("force on the environment  [N]", ("F", "F_c", "F_cd"), _forces, at_least=(0.0, 1.0)),
        Plot("sliding variable  ‖s‖  [mm/s]", ("s_norm", "s_bound", "s_band"), _sliding, logarithmic=True),
        Plot("gain  d  against what (17) needs  [N]", ("d", "d_required"), _guarantee, at_least=(0.0, 1.0)),
    ),
    "Torque": (
        Plot("joint torque  τ  [N·m]", ("tau",), _torques),
        Plot("residual of the model (8)  [N]", ("residual",), _per_coordinate("residual"), at_least=(-0.01, 0.01)),
    ),
}


_TIME = "s from now"
_NOW = uplot.Axis(
    scale="x",
    side=0,
    size=0,
    splits=(0.0,),
    values=("",),
    ticks={"show": False},
    grid={"show": True, "stroke": "rgba(140, 140, 140, 0.7)", "width": 1, "dash": (3.0, 3.0)},
)


class _Chart:
    """One plot on the page."""

    def __init__(self, gui: viser.GuiApi, plot: Plot) -> None:
        self.plot = plot
        self._lines: list[Line] = []
        self._handle = gui.add_uplot(
            (_EMPTY, np.full(2, _FLOOR)),
            (uplot.Series(label=_TIME), uplot.Series(label="")),
            title=plot.title,
            scales=self._scales(0.0),
            axes=(
                uplot.Axis(size=34, space=60),
                uplot.Axis(size=60, space=26, ticks={"show": not plot.logarithmic}),
                _NOW,
            ),
            cursor=uplot.Cursor(sync={"key": "vsmrc"}),
            height=150,
            padding=(10, 14, 0, 0),
        )

    def adapt(self, snapshot: Snapshot) -> None:
        """Take the lines that this run has."""
        self._lines = self.plot.lines(snapshot)
        self._handle.data = (_EMPTY, *(np.full(2, _FLOOR) for _ in self._lines))
        self._handle.series = (uplot.Series(label=_TIME), *(line.series() for line in self._lines))

    def set_height(self, pixels: int) -> None:
        self._handle.height = pixels

    def reach(self, ahead: float) -> None:
        """How far ahead of now the time axis goes, s. The page then builds the chart anew."""
        self._handle.scales = self._scales(ahead)

    def _scales(self, ahead: float) -> dict[str, uplot.Scale]:
        # An axis that stands still: viser's client may lose a moving one while the window is still growing.
        return {"x": uplot.Scale(time=False, range=(-WINDOW, ahead)), "y": self.plot.y_scale()}

    def draw(self, time: np.ndarray, stretches: Sequence[Signals]) -> None:
        """time (N,) s from now, of the rows of all stretches one behind the other."""
        columns = [
            np.concatenate([np.asarray(line.values(signals), dtype=float) for signals in stretches])
            for line in self._lines
        ]
        if self.plot.logarithmic:
            columns = [np.maximum(column, _FLOOR) for column in columns]
        self._handle.data = (time, *columns)


class Plots:
    """The left dock."""

    def __init__(self, gui: viser.GuiApi) -> None:
        panel = gui.add_panel()
        self._charts: list[tuple[int, _Chart]] = []
        for title, plots in TABS.items():
            with panel.add_tab(title):
                self._charts += [(len(plots), _Chart(gui, plot)) for plot in plots]
        panel.dock_left()
        panel.expand()  # on a phone too
        panel.set_width(400)
        self._signals = tuple({"t", *(name for _, chart in self._charts for name in chart.plot.signals)})
        self._key: object = None
        self._reach = 0.0

    def show(self, snapshot: Snapshot, outlook: Outlook | None, horizon: float) -> None:
        """Draw the last `WINDOW` s, and the preview over the next `horizon` s if there is one."""
        key = (tuple(snapshot.coordinates), tuple(snapshot.robot.joint_names))
        if key != self._key:
            self._key = key
            for _, chart in self._charts:
                chart.adapt(snapshot)
        signals = snapshot.recording.window(self._signals, snapshot.t - WINDOW, snapshot.t, POINTS)
        if len(signals["t"]) < 2:
            return
        reach = 0.0 if outlook is None else horizon
        if reach != self._reach:
            self._reach = reach
            for _, chart in self._charts:
                chart.reach(reach)
        time, stretches = signals["t"] - signals["t"][-1], [signals]
        if outlook is not None:
            time, stretches = np.concatenate([time, outlook.ahead]), [signals, outlook.signals]
        for _, chart in self._charts:
            chart.draw(time, stretches)

    def fit(self, page_height: int) -> None:
        """Share the height of the page among the plots of a tab."""
        for count, chart in self._charts:
            chart.set_height(int(min(max((page_height - 90) / count - 66, 96), 320)))
