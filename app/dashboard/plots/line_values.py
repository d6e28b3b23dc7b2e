"""Values of the lines of plots, as functions of the recorded signals."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from app.dashboard.plots.charts import Area, ChartLine, Signals
from app.dashboard.theme.colors import ACCENT, SERIES, Rgb

Values = Callable[[Signals], np.ndarray]
SOLID = 4  # lines of a plot that colour alone tells apart


def column(signal: str, index: int = 0, factor: float = 1.0) -> Values:
    """Values of one component of a signal, times a factor."""
    return lambda signals: factor * signals[signal].reshape(len(signals["t"]), -1)[:, index]


def total(*signals: Values) -> Values:
    """Sum of these values."""
    return lambda rows: np.sum([values(rows) for values in signals], axis=0)


def norm(signal: str) -> Values:
    """Euclidean norm of a signal."""
    return lambda signals: np.linalg.norm(signals[signal].reshape(len(signals["t"]), -1), axis=1)


def color(i: int) -> Rgb:
    """Color of coordinate, joint or part i."""
    return SERIES[i % len(SERIES)]


def is_dashed(i: int) -> bool:
    """Whether the line of coordinate, joint or part i is dashed: the colour-blind cannot tell more than SOLID colours
    apart."""
    return i >= SOLID


def stack(parts: Sequence[tuple[str, Values]]) -> tuple[list[ChartLine], list[Area]]:
    """Lines and areas that stack the named parts of a sum: positive ones upwards, negative ones downwards from zero."""
    lines = [ChartLine("", ACCENT, lambda signals: np.zeros(len(signals["t"])), width=0.0, listed=False)]
    areas = []
    for sign in (1.0, -1.0):
        for i, (name, _) in enumerate(parts):
            edge = _edge([values for _, values in parts[: i + 1]], sign)
            lines.append(ChartLine(name, color(i), edge, is_dashed(i), width=0.8, listed=sign > 0))
            here, below = len(lines) - 1, len(lines) - 2 if i else 0
            areas.append(Area(here, below, color(i)) if sign > 0 else Area(below, here, color(i)))
    return lines, areas


def _edge(parts: Sequence[Values], sign: float) -> Values:
    return lambda signals: sign * np.sum([np.maximum(sign * values(signals), 0.0) for values in parts], axis=0)


def difference(values: Values, others: Values) -> Values:
    """Difference of two values."""
    return lambda signals: values(signals) - others(signals)


def under_gain(values: Values) -> Values:
    """Values of the periods whose law has a gain d; those of other periods do not exist, since s means nothing
    there."""
    gain = column("d")
    return lambda signals: np.where(gain(signals) > 0.0, values(signals), np.inf)


def where_promised(values: Values) -> Values:
    """Values of the periods for which the theorem promises something; those of other periods do not exist."""
    bound = column("s_bound")
    return under_gain(lambda signals: np.where(np.isnan(bound(signals)), np.inf, values(signals)))
