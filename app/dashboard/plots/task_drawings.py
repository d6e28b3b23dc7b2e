"""Drawings of the task: what is followed, and the forces and moments on the environment."""

from __future__ import annotations

from app.analysis.metrics import MULTIPLIERS
from app.analysis.perturbation import STEADY
from app.dashboard.plots.charts import EXTREMES, SPREAD, ChartLine, Drawing, Setup
from app.dashboard.plots.line_values import color, column, difference, is_dashed, norm
from app.dashboard.theme.colors import ACCENT, DESIRED, MEASURED, PUSH, SERIES
from app.simulation.system import Coordinate

_MEASURED = (MEASURED, SERIES[0], SERIES[5])  # colours of the measured force on each surface


def tracking_error(setup: Setup) -> Drawing:
    """Drawing of e_r by coordinates."""
    lines = [
        ChartLine(coordinate.name, color(i), column("e_r", i, 1e3), is_dashed(i), compared=True, quantiles=EXTREMES)
        for i, coordinate in enumerate(setup.coordinates)
    ]
    return Drawing(f"tracking error  e_r  [{setup.units.error}]", lines, at_least=(-0.01, 0.01))


def position_error(setup: Setup) -> Drawing | None:
    """Drawing of the coordinates of e_r that are lengths, none without such."""
    lines = [
        ChartLine(coordinate.name, color(i), column("e_r", i, 1e3), is_dashed(i), compared=True, quantiles=EXTREMES)
        for i, coordinate in enumerate(setup.coordinates)
        if not coordinate.is_angle
    ]
    return Drawing("position error  e_r  [mm]", lines, at_least=(-0.01, 0.01)) if lines else None


def rotation_error(setup: Setup) -> Drawing | None:
    """Drawing of the coordinates of e_r that are angles, none without such."""
    lines = [
        ChartLine(
            _bare(coordinate),
            color(i),
            column("e_r", i, 1e3 / coordinate.per_radian),
            dashed=is_dashed(i),
            compared=True,
            quantiles=EXTREMES,
        )
        for i, coordinate in enumerate(setup.coordinates)
        if coordinate.is_angle
    ]
    title = "joint error" if setup.units.task == "joint" else "rotation error  e_r / ℓ"
    return Drawing(f"{title}  [mrad]", lines, at_least=(-0.01, 0.01)) if lines else None


def _bare(coordinate: Coordinate) -> str:
    """Symbol of the coordinate, or of the angle where the coordinate is ℓ times that."""
    return coordinate.name.removeprefix("ℓ·")


def one_coordinate(setup: Setup) -> Drawing:
    """Drawing of the chosen coordinate, desired and actual."""
    i, coordinate = setup.coordinate, setup.coordinates[setup.coordinate]
    factor, unit = 1e3 / coordinate.per_radian, "mrad" if coordinate.is_angle else "mm"
    lines = [
        ChartLine("desired", DESIRED, column("r_d", i, factor), dashed=True, width=2.0),
        ChartLine("actual", MEASURED, column("r", i, factor), compared=True, quantiles=SPREAD),
    ]
    return Drawing(f"{_bare(coordinate)}  against what is desired  [{unit}]", lines)


def force(setup: Setup) -> Drawing:
    """Drawing of the normal forces, desired and measured; without a controlled one, that of the force by axes."""
    if not setup.normal:
        return force_by_axes(setup)
    lines = []
    for i in range(setup.normal):
        lines += [
            ChartLine(f"desired normal{_on(setup, i)}", DESIRED, column("F_cd", i), dashed=True, width=2.0),
            ChartLine(
                f"measured normal{_on(setup, i)}", _MEASURED[i], column("F_c", i), compared=True, quantiles=SPREAD
            ),
        ]
    lines += [*_not_controlled(setup), ChartLine("push", PUSH, norm("F_push"))]
    return Drawing("force on the environment  [N]", lines, at_least=(0.0, 1.0))


def _not_controlled(setup: Setup) -> list[ChartLine]:
    """Lines of the normal forces, as they really are, on surfaces whose distance is followed beside pressed ones."""
    return [
        ChartLine(
            f"not controlled{_on(setup, i)}", _MEASURED[i], column(MULTIPLIERS[i]), compared=True, quantiles=SPREAD
        )
        for i in range(setup.normal, setup.surfaces)
    ]


def _on(setup: Setup, i: int) -> str:
    """Name of surface i, from 0, to be put behind a signal's name; "" where there is only one surface."""
    return "" if setup.surfaces == 1 else f" {'₁₂₃'[i]}"


def force_by_axes(_: Setup) -> Drawing:
    """Drawing of the measured force by the axes of the world."""
    lines = [
        ChartLine(f"F {axis}", color(i), column("F", i), compared=True, quantiles=EXTREMES)
        for i, axis in enumerate("xyz")
    ]
    lines.append(ChartLine("push", PUSH, norm("F_push"), dashed=True))
    return Drawing("force on the environment  [N]", lines, at_least=(0.0, 1.0))


def moment_by_axes(setup: Setup) -> Drawing | None:
    """Drawing of the measured moments: those of a flat tool, or by the axes of the world; none without a moment."""
    if setup.tilts:
        return _alignment(setup)
    if not setup.twisted:
        return None
    lines = [ChartLine(f"M {axis}", color(i), column("moment", i), compared=True) for i, axis in enumerate("xyz")]
    lines.append(ChartLine("push", PUSH, norm("moment_push"), dashed=True))
    return Drawing("moment on the environment  [N·m]", lines, at_least=(-0.05, 0.05))


def _alignment(setup: Setup) -> Drawing:
    """Drawing of the moments of a flat tool, which F_c holds divided by the length l."""
    lines = []
    for i, at in enumerate(setup.tilts):
        name, l = _bare(setup.coordinates[at]), setup.coordinates[at].per_radian
        lines += [
            ChartLine(f"desired {name}", DESIRED, column("F_cd", at, l), dashed=True, width=2.0),
            ChartLine(f"measured {name}", _MEASURED[i], column("F_c", at, l), compared=True, quantiles=SPREAD),
        ]
    return Drawing("moments of the flat tool  [N·m]", lines, at_least=(-0.05, 0.05))


def normal_force(setup: Setup) -> Drawing | None:
    """Drawing of the normal forces with their predicted steady state (37), none without a surface."""
    if not (setup.normal or setup.touching):
        return None
    lines = []
    for i in range(setup.normal or setup.surfaces):
        on = _on(setup, i)
        if setup.normal:
            lines.append(ChartLine(f"desired normal{on}", DESIRED, column("F_cd", i), dashed=True, width=2.0))
        if setup.normal or setup.surfaces == 1:
            lines.append(ChartLine(f"steady state predicted{on}", ACCENT, column(STEADY[i]), dashed=True, width=2.0))
        if setup.normal:
            lines.append(ChartLine(f"measured{on}", _MEASURED[i], column("F_c", i), compared=True, quantiles=SPREAD))
        else:
            lines.append(
                ChartLine(f"actual{on}", _MEASURED[i], column(MULTIPLIERS[i]), compared=True, quantiles=SPREAD)
            )
    lines += _not_controlled(setup) if setup.normal else []
    return Drawing("normal force  [N]", lines, at_least=(0.0, 1.0))


def force_error(setup: Setup) -> Drawing | None:
    """Drawing of the normal forces less the desired ones, none where no force is controlled."""
    if not setup.normal:
        return None
    lines = []
    for i in range(setup.normal):
        on, desired = _on(setup, i), column("F_cd", i)
        lines += [
            ChartLine(f"predicted (37){on}", ACCENT, difference(column(STEADY[i]), desired), dashed=True, width=2.0),
            ChartLine(
                f"measured − desired{on}",
                _MEASURED[i],
                difference(column("F_c", i), desired),
                compared=True,
                quantiles=SPREAD,
            ),
            ChartLine(f"real − desired{on}", color(2 + i), difference(column(MULTIPLIERS[i]), desired)),
        ]
    return Drawing("normal force error  [N]", lines, at_least=(-0.01, 0.01))
