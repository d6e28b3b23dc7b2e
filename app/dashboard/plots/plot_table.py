"""Table of plots: the plots of each tab, and the lines of each plot. A new plot is a row here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from app.analysis.metrics import MULTIPLIERS
from app.analysis.perturbation import STEADY
from app.analysis.spectrum import variation_rate
from app.dashboard.plots.charts import REACH, SPREAD, Area, ChartLine, Drawing, Plot, Setup, Signals
from app.dashboard.plots.line_values import (
    Values,
    color,
    column,
    difference,
    is_dashed,
    norm,
    stack,
    total,
    under_gain,
    where_promised,
)
from app.dashboard.theme.colors import ACCENT, BOUND, DESIRED, MEASURED, PUSH, SERIES
from app.dashboard.widgets.equation import symbol
from app.dashboard.widgets.premise_table import premises_html
from app.scenario.units import JOINT
from app.session.snapshot import Snapshot
from app.simulation.system import Coordinate

Chooser = Literal["coordinate", "joint"]
_MEASURED = (MEASURED, SERIES[0], SERIES[5])  # colours of the measured force on each surface
LEAD = 0.1  # s before the window, over which the total variation is taken


@dataclass(frozen=True)
class Tab:
    """Tab of the dock.
    plots: from top to bottom.
    choosers: above the plots.
    note: returns HTML that is shown above the plots, None for a tab without."""

    plots: tuple[Plot, ...]
    choosers: tuple[Chooser, ...] = ()
    note: Callable[[Snapshot], str] | None = None


def _errors(setup: Setup) -> Drawing:
    lines = [
        ChartLine(symbol(coordinate.name), color(i), column("e_r", i, 1e3), is_dashed(i), compared=True, band=REACH)
        for i, coordinate in enumerate(setup.coordinates)
    ]
    return Drawing(f"tracking error  e_r  [{setup.units.error}]", lines, at_least=(-0.01, 0.01))


def _positions(setup: Setup) -> Drawing | None:
    lines = [
        ChartLine(symbol(coordinate.name), color(i), column("e_r", i, 1e3), is_dashed(i), compared=True, band=REACH)
        for i, coordinate in enumerate(setup.coordinates)
        if not coordinate.is_angle
    ]
    return Drawing("position error  e_r  [mm]", lines, at_least=(-0.01, 0.01)) if lines else None


def _rotations(setup: Setup) -> Drawing | None:
    lines = [
        ChartLine(
            _bare(coordinate),
            color(i),
            column("e_r", i, 1e3 / coordinate.per_radian),
            dashed=is_dashed(i),
            compared=True,
            band=REACH,
        )
        for i, coordinate in enumerate(setup.coordinates)
        if coordinate.is_angle
    ]
    title = "joint error" if setup.units == JOINT else "rotation error  e_r / ℓ"
    return Drawing(f"{title}  [mrad]", lines, at_least=(-0.01, 0.01)) if lines else None


def _bare(coordinate: Coordinate) -> str:
    """Symbol of the coordinate, or of the angle where the coordinate is ℓ times that."""
    return symbol(coordinate.name.removeprefix("ℓ·"))


def _followed(setup: Setup) -> Drawing:
    i, coordinate = setup.coordinate, setup.coordinates[setup.coordinate]
    factor, unit = 1e3 / coordinate.per_radian, "mrad" if coordinate.is_angle else "mm"
    lines = [
        ChartLine("desired", DESIRED, column("r_d", i, factor), dashed=True, width=2.0),
        ChartLine("actual", MEASURED, column("r", i, factor), compared=True, band=SPREAD),
    ]
    return Drawing(f"{_bare(coordinate)}  against what is desired  [{unit}]", lines)


def _force(setup: Setup) -> Drawing:
    if not setup.normal:
        return _force_axes(setup)
    lines = []
    for i in range(setup.normal):
        lines += [
            ChartLine(f"desired normal{_on(setup, i)}", DESIRED, column("F_cd", i), dashed=True, width=2.0),
            ChartLine(f"measured normal{_on(setup, i)}", _MEASURED[i], column("F_c", i), compared=True, band=SPREAD),
        ]
    lines += [*_not_controlled(setup), ChartLine("push", PUSH, norm("F_push"))]
    return Drawing("force on the environment  [N]", lines, at_least=(0.0, 1.0))


def _not_controlled(setup: Setup) -> list[ChartLine]:
    """Lines of the normal forces, as they really are, on surfaces whose distance is followed beside pressed ones."""
    return [
        ChartLine(f"not controlled{_on(setup, i)}", _MEASURED[i], column(MULTIPLIERS[i]), compared=True, band=SPREAD)
        for i in range(setup.normal, setup.surfaces)
    ]


def _on(setup: Setup, i: int) -> str:
    """Name of surface i, from 0, to be put behind a signal's name; "" where there is only one surface."""
    return "" if setup.surfaces == 1 else f" {'₁₂₃'[i]}"


def _force_axes(_: Setup) -> Drawing:
    lines = [
        ChartLine(f"F {axis}", color(i), column("F", i), compared=True, band=REACH) for i, axis in enumerate("xyz")
    ]
    lines.append(ChartLine("push", PUSH, norm("F_push"), dashed=True))
    return Drawing("force on the environment  [N]", lines, at_least=(0.0, 1.0))


def _moments(setup: Setup) -> Drawing | None:
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
            ChartLine(f"measured {name}", _MEASURED[i], column("F_c", at, l), compared=True, band=SPREAD),
        ]
    return Drawing("moments of the flat tool  [N·m]", lines, at_least=(-0.05, 0.05))


def _normal_force(setup: Setup) -> Drawing | None:
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
            lines.append(ChartLine(f"measured{on}", _MEASURED[i], column("F_c", i), compared=True, band=SPREAD))
        else:
            lines.append(
                ChartLine(f"really there{on}", _MEASURED[i], column(MULTIPLIERS[i]), compared=True, band=SPREAD)
            )
    lines += _not_controlled(setup) if setup.normal else []
    return Drawing("normal force  [N]", lines, at_least=(0.0, 1.0))


def _force_error(setup: Setup) -> Drawing | None:
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
                band=SPREAD,
            ),
            ChartLine(f"real − desired{on}", color(2 + i), difference(column(MULTIPLIERS[i]), desired)),
        ]
    return Drawing("normal force error  [N]", lines, at_least=(-0.01, 0.01))


def _bound_and_band() -> tuple[Values, Values]:
    return column("s_bound", 0, 1e3), column("s_band", 0, 1e3)


def _s_norm() -> ChartLine:
    return ChartLine("‖s‖", color(0), under_gain(column("s_norm", 0, 1e3)), compared=True, band=SPREAD)


def _sliding(setup: Setup) -> Drawing:
    """Drawing of s, or, under a law without a bound on s, of the distance to the target model."""
    if not setup.robust:
        return _residual(setup)
    lines = [
        ChartLine("bound (20) + band", BOUND, where_promised(total(*_bound_and_band())), True, 2.0),
        _s_norm(),
    ]
    return Drawing(f"sliding variable  ‖s‖  [{setup.units.rate}]", lines, floor=1e-2)


def _phases() -> list[ChartLine]:
    """Lines that shade the reaching and the sliding phase, and mark the promised and the measured reaching time."""

    def spike(signal: str) -> Values:
        return lambda signals: 4.0 * signals[signal] - 1.0

    def sliding(signals: Signals) -> np.ndarray:
        return np.where(column("d")(signals) > 0.0, 1.0 - signals["reaching"], 0.0)

    return [
        ChartLine("reaching", MEASURED, column("reaching"), width=0.0, alpha=0.16, backdrop=True),
        ChartLine("sliding", ACCENT, sliding, width=0.0, alpha=0.07, backdrop=True),
        ChartLine("t_r ≤ (18)", BOUND, spike("promised"), dashed=True, width=1.0, alpha=0.9, backdrop=True),
        ChartLine("t_r", DESIRED, spike("measured"), width=1.0, alpha=0.9, backdrop=True),
    ]


def _reaching(setup: Setup) -> Drawing | None:
    if not setup.bounded:
        return None
    bound, band = _bound_and_band()
    lines = [
        *_phases(),
        ChartLine("(20)", DESIRED, where_promised(bound), width=2.0),
        ChartLine("(20) + band", BOUND, where_promised(total(bound, band)), dashed=True),
        _s_norm(),
    ]
    return Drawing(f"sliding variable  ‖s‖  [{setup.units.rate}]", lines, floor=0.1)


def _lyapunov(setup: Setup) -> Drawing | None:
    if not setup.bounded:
        return None
    lines = [
        ChartLine("(24)", BOUND, where_promised(column("V_bound", 0, 1e3)), width=2.0),
        ChartLine("(24) + sampling", BOUND, where_promised(column("V_limit", 0, 1e3)), dashed=True, width=1.4),
        ChartLine("V", color(0), under_gain(column("V", 0, 1e3))),
    ]
    return Drawing("Lyapunov function  V = ½ sᵀH s  [mJ]", lines, floor=1e-3)


def _components(setup: Setup) -> Drawing | None:
    if not setup.bounded:
        return None
    lines = [
        ChartLine(symbol(coordinate.name), color(i), under_gain(column("s", i, 1e3)), dashed=is_dashed(i))
        for i, coordinate in enumerate(setup.coordinates)
    ]
    return Drawing(f"s  [{setup.units.rate}]", lines, at_least=(-0.1, 0.1))


def _gain(setup: Setup) -> Drawing:
    """Drawing of the gain, or, under a law without a gain, of the torques."""
    if not setup.robust:
        return _torques(setup)
    lines = [
        ChartLine("needed (17)", BOUND, under_gain(column("d_required")), dashed=True, width=2.0),
        ChartLine("d", DESIRED, under_gain(column("d"))),
    ]
    return Drawing(f"gain  d  against what (17) needs  [{setup.units.force}]", lines, at_least=(0.0, 1.0))


CAUSES = ("inertia", "Coriolis", "gravity", "moving task", "disturbance", "ε")  # of `needed`
TERMS = ("inertia", "coriolis", "gravity", "force", "linear", "switching")  # of tau


def needed_stack() -> tuple[list[ChartLine], list[Area]]:
    """Lines and areas of the terms of (17), by their causes."""
    lines, areas = stack([(name, column("needed", i)) for i, name in enumerate(CAUSES)])
    upwards = len(CAUSES)  # no term is negative
    return lines[: 1 + upwards], areas[:upwards]


def _guarantee(setup: Setup) -> Drawing | None:
    if not setup.bounded:
        return None
    lines, areas = needed_stack()
    lines += [
        ChartLine("d", DESIRED, column("d"), width=2.4),
        ChartLine("real perturbation", ACCENT, column("perturbation"), width=2.0),
    ]
    return Drawing(f"d  over what (17) needs for each cause  [{setup.units.force}]", lines, areas, at_least=(0.0, 1.0))


def _perturbation(setup: Setup) -> Drawing:
    parts = (("inertia", 0), ("coriolis", 1), ("gravity", 2), ("disturbance", 4))
    lines = [ChartLine(CAUSES[i], color(i), column(name), dashed=is_dashed(i)) for name, i in parts]
    lines.append(ChartLine("together", ACCENT, column("perturbation"), width=2.6))
    return Drawing(f"real perturbation, cause by cause  [{setup.units.force}]", lines, at_least=(0.0, 1.0))


def _margins(setup: Setup) -> Drawing | None:
    if not setup.bounded:
        return None
    d, needed, real = under_gain(column("d")), column("d_required"), column("perturbation")
    lines = [
        ChartLine("d − needed (17)", BOUND, lambda s: d(s) - needed(s), dashed=True, width=2.0),
        ChartLine("d − real perturbation", DESIRED, lambda s: d(s) - real(s)),
    ]
    return Drawing(f"margin: below zero nothing is promised  [{setup.units.force}]", lines, at_least=(0.0, 1.0))


def _torques(setup: Setup) -> Drawing:
    lines = [
        ChartLine(f"τ{symbol(f'_{i + 1}')}", color(i), column("tau", i), dashed=is_dashed(i))
        for i in range(len(setup.joints))
    ]
    return Drawing("joint torque  τ  [N·m]", lines)


def torque_stack(joint: int) -> tuple[list[ChartLine], list[Area]]:
    """Lines and areas of the terms of (25) for one joint, counted from 0."""
    names = {"force": "Jᵀ F", "linear": "K_s s", "switching": "switching", "coriolis": "Coriolis"}
    return stack([(names.get(term, term), column(f"tau_{term}", joint)) for term in TERMS])


def _terms(setup: Setup) -> Drawing:
    lines, areas = torque_stack(setup.joint)
    lines.append(ChartLine("τ", ACCENT, column("tau", setup.joint), width=2.0))
    return Drawing(f"terms of  τ{symbol(f'_{setup.joint + 1}')}  (25)  [N·m]", lines, areas)


def _robust_terms(setup: Setup) -> Drawing | None:
    if not setup.bounded:
        return None
    lines = [
        ChartLine("−J_qᵀ K_s s", color(4), column("tau_linear", setup.joint)),
        ChartLine("−J_qᵀ d σ(s)", color(5), column("tau_switching", setup.joint)),
    ]
    return Drawing(f"robust terms of  τ{symbol(f'_{setup.joint + 1}')}  [N·m]", lines, at_least=(-0.1, 0.1))


def _spectrum(setup: Setup) -> Drawing:
    return Drawing("amplitude spectrum of  τ  [N·m]", _torques(setup).lines, floor=1e-3)


def _variation(setup: Setup) -> Drawing:
    def rate(joint: int) -> Values:
        tau = column("tau", joint)
        return lambda signals: variation_rate(signals["t"], tau(signals), LEAD)

    lines = [
        ChartLine(f"τ{symbol(f'_{i + 1}')}", color(i), rate(i), dashed=is_dashed(i), foreseen=False)
        for i in range(len(setup.joints))
    ]
    return Drawing("total variation of  τ  per second  [N·m/s]", lines, floor=1e-2)


def _residuals(setup: Setup) -> Drawing:
    lines = [
        ChartLine(symbol(coordinate.name), color(i), column("residual", i), dashed=is_dashed(i))
        for i, coordinate in enumerate(setup.coordinates)
    ]
    return Drawing(f"residual of the target model (8)  [{setup.units.force}]", lines, at_least=(-0.01, 0.01))


def _residual(setup: Setup) -> Drawing:
    lines = [*(_phases()[:2] if setup.bounded else ()), ChartLine("‖residual‖", color(0), norm("residual"))]
    return Drawing(f"norm of the residual  [{setup.units.force}]", lines, floor=1e-3)


def _reaching_note(snapshot: Snapshot) -> str:
    epoch = snapshot.state.epoch
    if not snapshot.system.controller.law.robust:
        return "s means nothing under this law: it has no bound and nothing to reach"
    if epoch.certificate.t_r < snapshot.scenario.controller.period:
        return f"s(0) = 0: nothing to reach (Remark 2), from t = {epoch.t:.2f} s on"
    stages = [("band", epoch.banded, epoch.banded_by)]
    if snapshot.scenario.controller.switching != "discontinuous":
        stages.append(("layer", epoch.reached, epoch.reached_by))

    def told(name: str, measured: float | None, promised: float | None) -> str:
        after = "not yet" if measured is None else f"<b>{measured - epoch.t:.3g} s</b>"
        by = "not promised" if promised is None else f"promised ≤ <b>{promised - epoch.t:.3g} s</b>"
        return f"{name} reached after {after} ({by})"

    stated = "; ".join(told(*stage) for stage in stages)
    return f"{stated}; s = 0 by (18) ≤ {epoch.certificate.t_r:.3g} s; from t = {epoch.t:.2f} s on"


TABS: dict[str, Tab] = {
    "Overview": Tab(
        (
            Plot("tracking error", _errors),
            Plot("force", _force),
            Plot("bound of s", _sliding),
            Plot("gain", _gain),
        )
    ),
    "Tracking": Tab(
        (Plot("position error", _positions), Plot("rotation error", _rotations), Plot("one coordinate", _followed)),
        ("coordinate",),
    ),
    "Force": Tab(
        (
            Plot("normal force", _normal_force),
            Plot("force error", _force_error),
            Plot("force by axes", _force_axes),
            Plot("moment by axes", _moments),
        )
    ),
    "Sliding": Tab(
        (Plot("reaching", _reaching), Plot("Lyapunov function", _lyapunov), Plot("components of s", _components)),
        note=_reaching_note,
    ),
    "Guarantee": Tab(
        (Plot("gain by causes", _guarantee), Plot("perturbation", _perturbation), Plot("margin", _margins)),
        note=premises_html,
    ),
    "Torque": Tab(
        (Plot("torques", _torques), Plot("terms of a torque", _terms), Plot("robust terms", _robust_terms)),
        ("joint",),
    ),
    "Chattering": Tab((Plot("spectrum", _spectrum, spectral=True), Plot("variation", _variation))),
    "Residual": Tab((Plot("residual", _residuals), Plot("norm of the residual", _residual))),
}
