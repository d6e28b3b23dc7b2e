"""Charts of the page: the lines of each plot, and the drawing of a run. `chart_frames` has their data for each refresh,
`chart_widget` what shows them.

Time runs to the right and ends at now; right of it stands the preview, which the page's script makes lighter. The
script also sets the ends of the time axis, which it reads from the tab's marker (`visible_parts.py`): if viser set
them, it would build the chart anew and lose the user's zoom. A line has gaps (nan) where its quantity does not exist:
beyond the end of a pinned run, or for a bound under a law without one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from viser import uplot

from app.dashboard.theme.colors import Dashes, Rgb, css
from app.scenario.units import Units, unit_of_joint
from app.session.snapshot import Snapshot
from app.simulation.builders.controller_builder import law_of
from app.simulation.system import Coordinate
from controllers.control_law import TorqueTerms

Signals = Mapping[str, np.ndarray]
BUCKETS = 120  # two points each: one per pixel or so of a plot on the dock, and no spike is lost
DASHED: Dashes = (6.0, 4.0)  # px
UNLISTED = "vs-unlisted"  # class of the lines that the legend leaves out
OF_RUN = "vs-run"  # class of the lines of pinned runs that are in the legend
EDGE = "vs-unlisted-edge"  # class of edges of the shown run's areas, which are hidden with the line of their name
MEDIAN = 0.5
SPREAD = (0.0, 0.05, MEDIAN, 0.95, 1.0)  # quantiles of a band in a plot of one quantity
EXTREMES = (0.0, 1.0)  # quantiles of a band in a plot of many
_DOCK, _ENTRY, _LETTER = 366, 54, 6  # px: width of the legend, of an entry with its value, and of a letter in it


@dataclass(frozen=True)
class Setup:
    """Setup of the charts: properties of a run and choices of the user that determine the lines.
    slides: whether each joint is prismatic.
    normal: number of surfaces on which the mode controls a normal force.
    surfaces: number of surfaces in the world.
    touching: whether there is something to touch.
    twisted: whether the law controls moments, or the scenario's push has one.
    tilts: numbers, from 0, of the coordinates that are tilts of a flat tool.
    robust: whether the law has a gain and a bound.
    bounded: whether some part of the run had a robust law.
    terms: name of each term that the torque has had in the run, by the field of `TorqueTerms`; the present law's names
    take precedence.
    units: of the task space.
    coordinate, joint: numbers of the chosen ones, from 0."""

    coordinates: tuple[Coordinate, ...]
    joints: tuple[str, ...]
    slides: tuple[bool, ...]
    normal: int
    surfaces: int
    touching: bool
    twisted: bool
    tilts: tuple[int, ...]
    robust: bool
    bounded: bool
    terms: Mapping[str, str]
    units: Units
    coordinate: int
    joint: int

    @classmethod
    def of(cls, snapshot: Snapshot, coordinate: int, joint: int) -> Setup:
        """Setup of a snapshot; a chosen coordinate or joint that the run does not have is replaced by the first."""
        coordinates, joints = tuple(snapshot.coordinates), tuple(snapshot.robot.joint_names)
        law = snapshot.system.controller.law
        epochs = {epoch.scenario.controller.law: epoch.scenario for epoch in tuple(snapshot.recording.epochs)}
        before = [law_of(scenario) for scenario in epochs.values()]
        named = {field: name for each in (*before, law) for field, name in each.named_terms.items()}
        return cls(
            coordinates,
            joints,
            snapshot.robot.slides,
            normal=snapshot.system.pressed,
            surfaces=len(snapshot.system.surfaces),
            touching=snapshot.scenario.contact.nature.touches,
            twisted=snapshot.system.mode.feedback == "all" or any(snapshot.scenario.truth.push_moment),
            tilts=tuple(range(snapshot.system.pressed, snapshot.system.m)),
            robust=law.robust,
            bounded=any(each.robust for each in before),
            terms={field: named[field] for field in TorqueTerms._fields if field in named},
            units=snapshot.system.units,
            coordinate=coordinate if coordinate < len(coordinates) else 0,
            joint=joint if joint < len(joints) else 0,
        )

    def unit_of_joint(self, unit: str) -> str:
        """Unit of a quantity of the chosen joint. unit: of a revolute one."""
        return unit_of_joint(unit, slides=self.slides[self.joint])


@dataclass(frozen=True)
class ChartLine:
    """Line of a chart.
    name: in the legend.
    values: (N,) of signals, nan where they are not known and infinite where they do not exist.
    compared: whether the same line of pinned runs is drawn, too.
    foreseen: whether the line has a meaning for the few instants of a preview.
    quantiles: those of true arms that are drawn around the preview, see `SPREAD` and `EXTREMES`.
    backdrop: whether 0 and 1 are the plot's foot and head, whatever its axis; without width, the area below is filled.
    listed: whether the line is in the legend.
    dashes: px, of line and gap in turn, in place of those of a dashed line.
    repeats: of a line of a pinned run, the names of the legend's other entries that it belongs to."""

    name: str
    color: Rgb
    values: Callable[[Signals], np.ndarray]
    dashed: bool = False
    width: float = 1.6
    alpha: float = 1.0
    compared: bool = False
    foreseen: bool = True
    quantiles: tuple[float, ...] = ()
    backdrop: bool = False
    listed: bool = True
    dashes: Dashes = ()
    repeats: tuple[str, ...] = ()

    def series(self) -> uplot.Series:
        look = uplot.Series(
            label=self.name, stroke=css(self.color, self.alpha), width=self.width, points={"show": False}
        )
        if self.dashes or self.dashed:
            look["dash"] = self.dashes or DASHED
        if self.backdrop:
            look["scale"] = "backdrop"
        if self.backdrop and not self.width:
            look["fill"] = css(self.color, self.alpha)
        if self.dashes:
            look["class"] = OF_RUN if self.listed else UNLISTED
        elif not self.listed:
            look["class"] = EDGE
        return look


@dataclass(frozen=True)
class Area:
    """Filled area between two of a drawing's lines, counted from 0."""

    upper: int
    lower: int
    color: Rgb


@dataclass(frozen=True)
class Drawing:
    """Content of a chart.
    title: with the unit.
    lines: from back to front.
    areas: between lines.
    floor: least value that a logarithmic axis shows, also in place of smaller ones; None for a linear axis.
    at_least: a range that is always in view, so that noise does not fill the plot."""

    title: str
    lines: Sequence[ChartLine]
    areas: Sequence[Area] = ()
    floor: float | None = None
    at_least: tuple[float, float] | None = None

    def legend_rows(self, pinned: Sequence[str]) -> int:
        """Estimated number of rows of the chart's legend on the dock. pinned: names of pinned runs."""
        compared = any(line.compared for line in self.lines)
        names = ["t [s]", *(line.name for line in self.lines if line.listed)]
        names += pinned if compared else []
        return -(-sum(_ENTRY + _LETTER * len(name) for name in names) // _DOCK)

    def y_scale(self) -> uplot.Scale:
        if self.floor is not None:
            return uplot.Scale(distr=3)
        if self.at_least is None:
            return uplot.Scale()
        low, high = ({"pad": 0.1, "soft": soft, "mode": 1} for soft in self.at_least)
        return uplot.Scale(range={"min": low, "max": high})


@dataclass(frozen=True)
class Plot:
    """Plot: a row of the table of plots.
    name: by which a figure for paper chooses the plot.
    draw: returns its drawing, None for a run where the plot has no meaning.
    spectral: whether its lines go over frequency instead of time."""

    name: str
    draw: Callable[[Setup], Drawing | None]
    spectral: bool = False
