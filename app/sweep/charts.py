"""Charts of a sweep: a map over two fields, slices over one, points of a design, parallel coordinates."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from app.export.figures import DOUBLE, SINGLE
from app.export.formats import Format
from app.export.lettering import wrapped
from app.export.printing import file_of
from app.export.ticks import plain_decades
from app.scenario.errors import ScenarioError
from app.scenario.number_text import counted
from app.storage.joint_kinds import units_of
from app.sweep.axes import Axis
from app.sweep.plan import Sweep, SweepPlan
from app.sweep.points import Kind, Points, SweepView, interval, points_of, statistic_of
from app.sweep.run_metrics import COLUMNS, metric_title
from app.sweep.titles import named, title_of, unit_of, value_in_words
from parameters import allowed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

MOST_TEXTS = 150  # tiles that have their counts written in them
MOST_SLICES = 8  # lines of a picture
WIDE = 100.0  # ratio of values from which on they are shown by their logarithm
COLORS = "viridis"
ASPECT = 0.75
SHORT = 28  # letters of a legend of two columns
LABEL, LEGEND = 2.3, 2.9  # in, longest line beside an axis, and in a legend of one column


def chart(sweep: Sweep, columns: Mapping[str, np.ndarray], view: SweepView, form: Format) -> bytes:
    """File of a chart in this form. Raises ScenarioError where the view makes no sense for this sweep."""
    axes = _axes(sweep, view)
    points = points_of(sweep, columns, view)
    kind = view.kind or _suiting(sweep, axes)
    draw = {"map": _map, "slices": _slices, "scatter": _scatter, "parallel": _parallel}[kind]
    return file_of(lambda: draw(sweep, axes, points, view), form)


def _axes(sweep: Sweep, view: SweepView) -> list[Axis]:
    by_path = {axis.path: axis for axis in sweep.vary}
    if not by_path:
        raise ScenarioError("sweep plot: no field is varied; allowed: a sweep with --vary")
    for path in view.over:
        if path not in by_path:
            raise ScenarioError(f"--over {path!r:.60}; {allowed(path, by_path)}")
        if view.over.count(path) > 1:
            raise ScenarioError(f"--over {path} twice; allowed: each field once")
    return [by_path[path] for path in view.over] or list(by_path.values())


def _suiting(sweep: Sweep, axes: list[Axis]) -> Kind:
    if len(axes) == 1 and axes[0].numeric:
        if sweep.design != "grid" and len(sweep.vary) > 1:
            raise ScenarioError(f"--over {axes[0].path} alone; allowed: two or more fields of a design")
        return "slices"
    if len(axes) == 2 and len(sweep.vary) == 2 and all(axis.numeric for axis in axes):
        return "map" if sweep.design == "grid" else "scatter"
    return "parallel"


def _map(sweep: Sweep, axes: list[Axis], points: Points, view: SweepView) -> Canvas:
    if len(axes) != 2 or len(sweep.vary) != 2 or sweep.design != "grid" or not all(a.numeric for a in axes):
        raise ScenarioError("--as map; allowed: with a grid of two fields of numbers, or --as parallel")
    x, y = axes
    xs, ys = (np.array(sorted(map(float, axis.values))) for axis in axes)
    grid = _Grid(np.searchsorted(xs, points.values[x.path]), np.searchsorted(ys, points.values[y.path]))
    shape = (len(ys), len(xs))
    canvas, plot = sheet(SINGLE, _caption(sweep, points, view, missing="White", stopped="A cross"))
    edges_x, edges_y = _edges(xs, x), _edges(ys, y)
    tiles = plot.pcolormesh(edges_x, edges_y, grid.of(points.number, shape), cmap=COLORS, norm=_norm(points, view))
    _log_scales(plot, x, y)
    _bar(canvas, plot, tiles, sweep, points, view)
    centres = [(float(xs[i]), float(ys[j])) for i, j in zip(grid.i, grid.j, strict=True)]
    few = len(centres) <= MOST_TEXTS and points.arms.max() > 1
    for k, at in enumerate(centres):
        if points.stopped[k]:
            _cross(plot, [at[0]], [at[1]])
        if few and statistic_of(view) == "share" and not math.isnan(points.number[k]):
            shade = "white" if points.number[k] < 0.6 else "black"
            plot.annotate(
                f"{points.good[k]}/{points.counted[k]}",
                at,
                xytext=(0.0, 4.0 if points.stopped[k] else 0.0),
                textcoords="offset points",
                ha="center",
                va="center",
                fontsize=4.5,
                color=shade,
            )
    for holds, style, name in (
        (points.declared, {"color": "#d03030", "linewidth": 1.6}, "declared ends"),
        (points.theorem, {"color": "black", "linewidth": 1.2, "linestyle": (0, (4, 2))}, "(17) ends"),
    ):
        lines = _borders(grid.of(holds, shape), edges_x, edges_y)
        for number, (across, up) in enumerate(lines):
            plot.plot(across, up, label=name if number == 0 else None, **style)
    if plot.get_legend_handles_labels()[0]:
        plot.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False, fontsize=6.0)
    plot.set_xlabel(_of_axis(x, sweep))
    plot.set_ylabel(_of_axis(y, sweep))
    plot.grid(visible=False)
    return canvas


def _slices(sweep: Sweep, axes: list[Axis], points: Points, view: SweepView) -> Canvas:
    x = (axes if view.over else sorted(axes, key=lambda axis: not axis.numeric))[0]
    if not x.numeric:
        raise ScenarioError(f"--as slices over {x.path}; allowed: a field of numbers first")
    if sweep.design != "grid" and len(sweep.vary) > 1:
        raise ScenarioError("--as slices of a design; allowed: of a grid, or --as scatter or parallel")
    canvas, plot = sheet(SINGLE, _caption(sweep, points, view, missing="Left out", stopped="A cross"))
    # for matplotlib a point without a number does not count
    plot.update_datalim([(end, 0.0) for end in _ends(x)], updatey=False)
    rest = [axis.path for axis in sweep.vary if axis.path != x.path]
    keys = [tuple(points.values[path][k] for path in rest) for k in range(len(points.number))]
    lines = list(dict.fromkeys(keys))
    drawn = [lines[k] for k in np.unique(np.linspace(0, len(lines) - 1, min(len(lines), MOST_SLICES)).astype(int))]
    for color, key in zip(_colors(len(drawn)), drawn, strict=True):
        mine = np.array([k for k, each in enumerate(keys) if each == key])
        mine = mine[np.argsort(np.asarray(points.values[x.path][mine], dtype=float))]
        at = np.asarray(points.values[x.path][mine], dtype=float)
        name = ", ".join(
            f"{title_of(path)} {value_in_words(path, value)} {unit_of(path, units_of(sweep.scenario))}".rstrip()
            for path, value in zip(rest, key, strict=True)
        )
        name = "\n".join(wrapped(name, LEGEND, 6.0))
        plot.plot(at, points.number[mine], "-o", color=color, markersize=2.2, linewidth=1.0, label=name or None)
        if statistic_of(view) == "share" and sweep.draw:
            ends = np.array([interval(int(points.good[k]), int(points.counted[k])) for k in mine])
            ends[np.isnan(points.number[mine])] = np.nan
            plot.fill_between(at, ends[:, 0], ends[:, 1], color=color, alpha=0.18, linewidth=0)
        stopped = np.asarray(points.values[x.path][mine[points.stopped[mine]]], dtype=float)
        if len(stopped):  # at the foot: most have no number
            _cross(plot, stopped, np.full(len(stopped), 0.03), transform=plot.get_xaxis_transform())
    if any(keys) and rest:
        left_out = f"{len(drawn)} of {len(lines)} lines" if len(drawn) < len(lines) else None
        canvas.legend(
            *plot.get_legend_handles_labels(),
            loc="outside upper center",
            ncols=1 if max(map(len, plot.get_legend_handles_labels()[1])) > SHORT else 2,
            frameon=False,
            fontsize=6.0,
            title=left_out,
            title_fontsize=6.0,
        )
    _log_scales(plot, x)
    if statistic_of(view) != "share" and wide(points.number):
        plot.set_yscale("log")
        plain_decades(plot.yaxis)
    plot.set_xlabel(_of_axis(x, sweep))
    plot.set_ylabel(_label(sweep, points, view))
    return canvas


def _scatter(sweep: Sweep, axes: list[Axis], points: Points, view: SweepView) -> Canvas:
    if len(axes) < 2 or not all(axis.numeric for axis in axes[:2]):
        raise ScenarioError("--as scatter; allowed: with two fields of numbers, see --over")
    x, y = axes[:2]
    if sweep.design == "grid" and len(sweep.vary) > 2:
        rest = next(axis.path for axis in sweep.vary if axis.path not in (x.path, y.path))
        raise ScenarioError(
            f"--as scatter over {x.path} and {y.path}: points of other {rest} would lie below one another; allowed: "
            "--as parallel, or a design"
        )
    canvas, plot = sheet(SINGLE, _caption(sweep, points, view, missing="Left out", stopped="A cross"))
    at = [np.asarray(points.values[axis.path], dtype=float) for axis in (x, y)]
    dots = plot.scatter(*at, c=points.number, cmap=COLORS, norm=_norm(points, view), s=9, linewidths=0)
    _bar(canvas, plot, dots, sweep, points, view)
    _cross(plot, at[0][points.stopped], at[1][points.stopped])
    _log_scales(plot, x, y)
    plot.set_xlabel(_of_axis(x, sweep))
    plot.set_ylabel(_of_axis(y, sweep))
    return canvas


def _parallel(sweep: Sweep, axes: list[Axis], points: Points, view: SweepView) -> Canvas:
    from matplotlib import colormaps

    if len(axes) < 2 and axes[0].numeric:
        raise ScenarioError(f"--as parallel over {axes[0].path} alone; allowed: two or more fields, or --as slices")
    canvas, plot = sheet(DOUBLE, _caption(sweep, points, view, missing="Grey", stopped="Grey"))
    norm, map_ = _norm(points, view), colormaps[COLORS]
    columns = [_fractions(axis, points.values[axis.path]) for axis in axes]
    less_is_worse = statistic_of(view) == "share" or COLUMNS[view.metric].more_is_better
    badness = -points.number if less_is_worse else points.number
    worst_last = np.argsort(np.nan_to_num(badness, nan=np.inf))  # so that no good line covers them
    for k in worst_last:
        value = points.number[k]
        color = "0.6" if math.isnan(value) else map_(norm(value))
        places = [column[k] for column in columns]
        plot.plot(range(len(axes)), places, "-o" if len(axes) == 1 else "-", color=color, linewidth=0.6, alpha=0.8)
    for k, axis in enumerate(axes):
        low, high = _ends(axis) if axis.numeric else (axis.at(0.0), axis.at(1.0))
        plot.text(k, -0.03, value_in_words(axis.path, low), ha="center", va="top", fontsize=6.0)
        plot.text(k, 1.03, value_in_words(axis.path, high), ha="center", va="bottom", fontsize=6.0)
        plot.axvline(k, color="0.35", linewidth=0.5)
    from matplotlib.cm import ScalarMappable

    _bar(canvas, plot, ScalarMappable(norm, map_), sweep, points, view)
    plot.set_xticks(range(len(axes)), [_of_axis(axis, sweep) for axis in axes])
    plot.tick_params(axis="x", pad=9)
    plot.set_yticks([])
    plot.set_ylim(-0.01, 1.01)
    plot.grid(visible=False)
    return canvas


def _cross(plot: Axes, x: Any, y: Any, **more: Any) -> None:
    """Draw a cross on each of these points, dark with a light edge: it is seen on every colour."""
    for color, size, width in (("white", 4.0, 1.8), ("0.15", 3.0, 0.7)):
        plot.plot(x, y, "x", color=color, markersize=size, markeredgewidth=width, zorder=4, **more)


class _Grid:
    """Places of points in a grid: columns i, rows j."""

    def __init__(self, i: np.ndarray, j: np.ndarray) -> None:
        self.i, self.j = i, j

    def of(self, values: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
        """Values of the points as a table of rows, NaN where there is no point."""
        table = np.full(shape, np.nan)
        table[self.j, self.i] = values
        return table


def _borders(holds: np.ndarray, xs: np.ndarray, ys: np.ndarray) -> list[tuple[list[float], list[float]]]:
    """Edges between tiles of which one holds (1) and the other one does not (0)."""
    upright, level = (holds[:, :-1] + holds[:, 1:] == 1.0), (holds[:-1] + holds[1:] == 1.0)
    x, y = xs.tolist(), ys.tolist()
    return [
        *(([x[i + 1], x[i + 1]], [y[j], y[j + 1]]) for j, i in np.argwhere(upright).tolist()),
        *(([x[i], x[i + 1]], [y[j + 1], y[j + 1]]) for j, i in np.argwhere(level).tolist()),
    ]


def sheet(width: float, caption: str) -> tuple[Canvas, Axes]:
    """Empty figure of this width (in) with one pair of axes above a caption."""
    from matplotlib.figure import Figure as Canvas
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    lines = wrapped(caption, width - 0.12, 6.0)
    below = 0.11 * len(lines) + 0.1
    height = width * (ASPECT if width == SINGLE else 0.4) + below
    layout = ConstrainedLayoutEngine(rect=(0.0, below / height, 1.0, 1.0 - below / height))
    canvas = Canvas(figsize=(width, height), layout=layout)
    for k, line in enumerate(lines):
        canvas.text(0.06 / width, (below - 0.11 * (k + 1)) / height, line, fontsize=6.0, color="0.3")
    return canvas, canvas.add_subplot()


def _caption(sweep: Sweep, points: Points, view: SweepView, missing: str, stopped: str) -> str:
    """Caption. missing, stopped: what points without a number look like, and those of which a run stopped or was
    refused; where both look the same, one that has a number looks like any other."""
    arms, plan = sweep.arms, SweepPlan(sweep)
    caption = f"{sweep.scenario.name}, {counted(len(points.number), 'point')}"
    if sweep.draw:
        kind = "corners of the declared set" if sweep.corners else "inside the declared set"
        moved = any(axis.path.startswith(("declared.", "robot.")) for axis in sweep.vary)
        same = "the same shares of what is declared" if moved else "the same"
        caption += f", {arms} true arms each, {kind}, {same} at every point"
    if (runs := int(points.arms.sum())) < plan.count:
        caption += f". Only {runs} of {plan.count} runs so far"
        if fewer := int((points.arms < arms).sum()):
            caption += f", {counted(fewer, 'point')} with fewer arms"
    if fewer := int(((points.counted < points.arms) & (points.counted > 0)).sum()):
        caption += f". In {counted(fewer, 'point')} only some arms have this metric, and they alone count"
    if statistic_of(view) == "share" and sweep.draw:
        low, _ = interval(arms, arms)
        caption += f". {arms} of {arms} is a share of at least {low:.2g} (95 %, Wilson)"
    elif statistic_of(view) == "share":  # one run is no sample
        caption += ". 1: the run keeps the limit, 0: it does not"
    marked = points.stopped & np.isnan(points.number) if stopped == missing else points.stopped
    if marked.any():
        caption += f". {stopped}: runs that stopped or were refused ({counted(int(marked.sum()), 'point')})"
    if never := int((points.never & ~points.stopped).sum()):
        caption += f". {missing}: not on every arm ({counted(never, 'point')})"
    if none := int((np.isnan(points.number) & ~points.never & ~points.stopped).sum()):
        caption += f". {missing}: no run has this metric ({counted(none, 'point')})"
    return caption + "."


def _bar(canvas: Canvas, plot: Axes, colored: Any, sweep: Sweep, points: Points, view: SweepView) -> None:
    bar = canvas.colorbar(colored, ax=plot, label=_label(sweep, points, view), pad=0.02)
    if statistic_of(view) != "share" and wide(points.number):
        plain_decades(bar.ax.yaxis)


def _label(sweep: Sweep, points: Points, view: SweepView) -> str:
    column, name = COLUMNS[view.metric], metric_title(view.metric)
    unit = f" [{known}]" if (known := column.unit_in(units_of(sweep.scenario))) else ""
    if view.within is not None:
        kept = f"{name} {'≥' if column.more_is_better else '≤'} {view.within:g} {known}".rstrip()
        return f"share of arms with {kept}" if sweep.draw else kept
    return f"{name}, {statistic_of(view)} arm{unit}" if points.arms.max() > 1 else f"{name}{unit}"


def _of_axis(axis: Axis, sweep: Sweep) -> str:
    """Title of an axis, in lines."""
    return "\n".join(wrapped(named(axis.path, units_of(sweep.scenario)), LABEL, 7.0))


def _norm(points: Points, view: SweepView) -> Any:
    from matplotlib.colors import LogNorm, Normalize

    if statistic_of(view) == "share":
        return Normalize(0.0, 1.0)
    known = points.number[np.isfinite(points.number)]
    if not len(known):
        return Normalize(0.0, 1.0)
    if wide(known):
        return LogNorm(known.min(), known.max())
    low, high = known.min(), known.max()
    return Normalize(low, high if high > low else low + (abs(low) or 1.0))  # one value stands at the scale's foot


def wide(values: np.ndarray) -> bool:
    """Whether values are shown by their logarithm: all above 0, and far apart."""
    known = values[np.isfinite(values)]
    return len(known) > 1 and bool((known > 0.0).all()) and known.max() > WIDE * known.min()


def _edges(values: np.ndarray, axis: Axis) -> np.ndarray:
    """Edges of tiles around the values of an axis, in the middle between them."""
    scaled = np.log(values) if axis.on_log_scale else values
    steps = np.diff(scaled) if len(scaled) > 1 else np.array([1.0])
    edges = np.r_[scaled[0] - steps[0] / 2, scaled[:-1] + steps[: len(scaled) - 1] / 2, scaled[-1] + steps[-1] / 2]
    return np.exp(edges) if axis.on_log_scale else edges


def _log_scales(plot: Axes, x: Axis, y: Axis | None = None) -> None:
    if x.on_log_scale:
        plot.set_xscale("log")
        plain_decades(plot.xaxis)
    if y is not None and y.on_log_scale:
        plot.set_yscale("log")
        plain_decades(plot.yaxis)


def _ends(axis: Axis) -> tuple[float, float]:
    """Least and largest value of an axis of numbers."""
    values = [float(value) for value in axis.values] or [axis.low, axis.high]
    return min(values), max(values)


def _fractions(axis: Axis, values: np.ndarray) -> np.ndarray:
    """Places (N,) of values along an axis, 0 to 1."""
    if not axis.numeric:
        names = [str(value) for value in axis.values]
        return np.array([names.index(str(value)) for value in values]) / max(len(names) - 1, 1)
    at = np.asarray(values, dtype=float)
    low, high = _ends(axis)
    if axis.on_log_scale:
        at, low, high = np.log(at), math.log(low), math.log(high)
    return (at - low) / ((high - low) or 1.0)


def _colors(count: int) -> list[Any]:
    from matplotlib import colormaps

    return [colormaps[COLORS](0.1 + 0.75 * k / max(count - 1, 1)) for k in range(count)]
