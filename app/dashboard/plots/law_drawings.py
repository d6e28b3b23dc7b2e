"""Drawings of the control law: sliding variable, gain, perturbation, torques and residual of the target model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from app.analysis.perturbation import PARTS
from app.analysis.spectrum import variation_rate
from app.dashboard.plots.charts import SPREAD, Area, ChartLine, Drawing, Setup, Signals
from app.dashboard.plots.line_values import (
    Values,
    color,
    column,
    is_dashed,
    norm,
    stack,
    total,
    under_gain,
    where_promised,
)
from app.dashboard.theme.colors import ACCENT, BOUND, DESIRED, MEASURED
from app.scenario.units import indexed
from app.session.snapshot import Snapshot
from controllers.bounds import CAUSES

LEAD = 0.1  # s before the window, over which the total variation is taken


def _bound_and_band() -> tuple[Values, Values]:
    return column("s_bound", 0, 1e3), column("s_band", 0, 1e3)


def _s_norm() -> ChartLine:
    return ChartLine("‖s‖", color(0), under_gain(column("s_norm", 0, 1e3)), compared=True, quantiles=SPREAD)


def bound_of_s(setup: Setup) -> Drawing:
    """Drawing of s, or, under a law without a bound on s, of the distance to the target model."""
    if not setup.robust:
        return norm_of_residual(setup)
    lines = [
        ChartLine("bound (20) + band", BOUND, where_promised(total(*_bound_and_band())), True, 2.0),
        _s_norm(),
    ]
    return Drawing(f"sliding variable  ‖s‖  [{setup.units.rate}]", lines, floor=1e-2)


def _phases() -> list[ChartLine]:
    """Lines that shade the reaching and the sliding phase, and mark the promised and the measured reaching time."""

    def spike(signal: str) -> Values:
        return lambda signals: 4.0 * signals[signal] - 1.0

    def after_reaching(signals: Signals) -> np.ndarray:
        return np.where(column("d")(signals) > 0.0, 1.0 - signals["reaching"], 0.0)

    return [
        ChartLine("reaching", MEASURED, column("reaching"), width=0.0, alpha=0.16, backdrop=True),
        ChartLine("sliding", ACCENT, after_reaching, width=0.0, alpha=0.07, backdrop=True),
        ChartLine("t_r ≤ (18)", BOUND, spike("promised"), dashed=True, width=1.0, alpha=0.9, backdrop=True),
        ChartLine("t_r", MEASURED, spike("measured"), width=1.0, alpha=0.9, backdrop=True),
    ]


def reaching(setup: Setup) -> Drawing | None:
    """Drawing of ||s|| with its bound (20), none without a bound."""
    if not setup.bounded:
        return None
    bound, band = _bound_and_band()
    lines = [
        *_phases(),
        ChartLine("(20)", BOUND, where_promised(bound), width=2.0),
        ChartLine("(20) + band", BOUND, where_promised(total(bound, band)), dashed=True),
        _s_norm(),
    ]
    return Drawing(f"sliding variable  ‖s‖  [{setup.units.rate}]", lines, floor=0.1)


def lyapunov_function(setup: Setup) -> Drawing | None:
    """Drawing of V with its bound (24), none without a bound."""
    if not setup.bounded:
        return None
    lines = [
        ChartLine("(24)", BOUND, where_promised(column("V_bound", 0, 1e3)), width=2.0),
        ChartLine("(24) + sampling", BOUND, where_promised(column("V_limit", 0, 1e3)), dashed=True, width=1.4),
        ChartLine("V", color(0), under_gain(column("V", 0, 1e3))),
    ]
    return Drawing("Lyapunov function  V = ½ sᵀH s  [mJ]", lines, floor=1e-3)


def components_of_s(setup: Setup) -> Drawing | None:
    """Drawing of the sliding variable by coordinates, none without a bound."""
    if not setup.bounded:
        return None
    lines = [
        ChartLine(coordinate.name, color(i), under_gain(column("s", i, 1e3)), dashed=is_dashed(i))
        for i, coordinate in enumerate(setup.coordinates)
    ]
    return Drawing(f"s  [{setup.units.rate}]", lines, at_least=(-0.1, 0.1))


def gain(setup: Setup) -> Drawing:
    """Drawing of the gain, or, under a law without a gain, of the torques."""
    if not setup.robust:
        return torques(setup)
    lines = [
        ChartLine("needed (17)", BOUND, under_gain(column("d_required")), dashed=True, width=2.0),
        ChartLine("d", DESIRED, under_gain(column("d"))),
    ]
    return Drawing(f"gain  d  against what (17) needs  [{setup.units.force}]", lines, at_least=(0.0, 1.0))


def needed_stack() -> tuple[list[ChartLine], list[Area]]:
    """Lines and areas of the terms of (17), by their causes."""
    lines, areas = stack([(words, column("needed", i)) for i, words in enumerate(CAUSES.values())])
    upwards = len(CAUSES)  # no term is negative
    return lines[: 1 + upwards], areas[:upwards]


def gain_by_causes(setup: Setup) -> Drawing | None:
    """Drawing of d and the real perturbation over the terms of (17), none without a bound."""
    if not setup.bounded:
        return None
    lines, areas = needed_stack()
    lines += [
        ChartLine("d", DESIRED, column("d"), width=2.4),
        ChartLine("real perturbation", ACCENT, column("perturbation"), width=2.0),
    ]
    return Drawing(f"d  over what (17) needs for each cause  [{setup.units.force}]", lines, areas, at_least=(0.0, 1.0))


def perturbation(setup: Setup) -> Drawing:
    """Drawing of the real perturbation by its causes."""
    lines = [
        ChartLine(words, color(i), column(cause), dashed=is_dashed(i))
        for i, (cause, words) in enumerate(CAUSES.items())
        if cause in PARTS
    ]
    lines.append(ChartLine("together", ACCENT, column("perturbation"), width=2.6))
    return Drawing(f"real perturbation, cause by cause  [{setup.units.force}]", lines, at_least=(0.0, 1.0))


def margin(setup: Setup) -> Drawing | None:
    """Drawing of d less what (17) needs, and less the real perturbation; none without a bound."""
    if not setup.bounded:
        return None
    d, needed, real = under_gain(column("d")), column("d_required"), column("perturbation")
    lines = [
        ChartLine("d − needed (17)", BOUND, lambda s: d(s) - needed(s), dashed=True, width=2.0),
        ChartLine("d − real perturbation", DESIRED, lambda s: d(s) - real(s)),
    ]
    return Drawing(f"margin: below zero nothing is promised  [{setup.units.force}]", lines, at_least=(0.0, 1.0))


def torques(setup: Setup) -> Drawing:
    """Drawing of the joint torques."""
    lines = [
        ChartLine(indexed("τ", i + 1), color(i), column("tau", i), dashed=is_dashed(i))
        for i in range(len(setup.joints))
    ]
    what = {"revolute": "joint torque", "prismatic": "joint force", "mixed": "joint torques and forces"}
    return Drawing(f"{what[setup.units.joints]}  τ  [{setup.units.of_joints('N·m')}]", lines)


def torque_stack(terms: Mapping[str, str], joint: int) -> tuple[list[ChartLine], list[Area]]:
    """Lines and areas of the terms of the torque for one joint, counted from 0. terms: as in `Setup`."""
    return stack([(name, column(f"tau_{term}", joint)) for term, name in terms.items()])


def terms_of_torque(setup: Setup) -> Drawing:
    """Drawing of the terms of the law's torque for the chosen joint, and of their sum."""
    lines, areas = torque_stack(setup.terms, setup.joint)
    lines.append(ChartLine("τ", ACCENT, column("tau", setup.joint), width=2.0))
    what = f"terms of  {indexed('τ', setup.joint + 1)}{'  (25)' if setup.robust else ''}"
    return Drawing(f"{what}  [{setup.unit_of_joint('N·m')}]", lines, areas)


def robust_terms(setup: Setup) -> Drawing | None:
    """Drawing of the linear and the switching term for the chosen joint, none without a bound."""
    if not setup.bounded:
        return None
    lines = [
        ChartLine("−J_qᵀ K_s s", color(4), column("tau_linear", setup.joint)),
        ChartLine("−J_qᵀ d σ(s)", color(5), column("tau_switching", setup.joint)),
    ]
    title = f"robust terms of  {indexed('τ', setup.joint + 1)}  [{setup.unit_of_joint('N·m')}]"
    return Drawing(title, lines, at_least=(-0.1, 0.1))


def spectrum(setup: Setup) -> Drawing:
    """Drawing of the amplitude spectrum of the joint torques."""
    return Drawing(f"amplitude spectrum of  τ  [{setup.units.of_joints('N·m')}]", torques(setup).lines, floor=1e-3)


def variation(setup: Setup) -> Drawing:
    """Drawing of the torque variation by joints."""

    def rate(joint: int) -> Values:
        tau = column("tau", joint)
        return lambda signals: variation_rate(signals["t"], tau(signals), LEAD)

    lines = [
        ChartLine(indexed("τ", i + 1), color(i), rate(i), dashed=is_dashed(i), foreseen=False)
        for i in range(len(setup.joints))
    ]
    return Drawing(f"torque variation  Σ|Δτ| per second  [{setup.units.of_joints('N·m/s')}]", lines, floor=1e-2)


def residual(setup: Setup) -> Drawing:
    """Drawing of the residual of (8) by coordinates."""
    lines = [
        ChartLine(coordinate.name, color(i), column("residual", i), dashed=is_dashed(i))
        for i, coordinate in enumerate(setup.coordinates)
    ]
    return Drawing(f"residual of the target model (8)  [{setup.units.force}]", lines, at_least=(-0.01, 0.01))


def norm_of_residual(setup: Setup) -> Drawing:
    """Drawing of the norm of the residual of (8)."""
    lines = [*(_phases()[:2] if setup.bounded else ()), ChartLine("‖residual‖", color(0), norm("residual"))]
    return Drawing(f"norm of the residual  [{setup.units.force}]", lines, floor=1e-3)


def reaching_note(snapshot: Snapshot) -> str:
    """Note on the measured and the promised reaching times, as HTML."""
    epoch = snapshot.state.epoch
    if not snapshot.system.controller.law.robust:
        return "this law does not use s: it has no bound and no reaching phase"
    if epoch.certificate.t_r < snapshot.scenario.controller.period:
        return f"no reaching phase since t = {epoch.t:.2f} s: s = 0 there (Remark 2)"
    stages = [("band", epoch.band_reached, epoch.band_reached_by)]
    if snapshot.system.controller.has_layer:
        stages.append(("layer", epoch.layer_reached, epoch.layer_reached_by))

    def stage_in_words(name: str, measured: float | None, promised: float | None) -> str:
        after = "not yet" if measured is None else f"<b>{measured - epoch.t:.3g} s</b>"
        by = "not promised" if promised is None else f"promised ≤ <b>{promised - epoch.t:.3g} s</b>"
        return f"{name} reached after {after} ({by})"

    stated = "; ".join(stage_in_words(*stage) for stage in stages)
    promised = epoch.band_reached_by is not None
    by_18 = f"s = 0 within {epoch.certificate.t_r:.3g} s by (18)" if promised else "(18) promises nothing"
    return f"{stated}; {by_18}; counted from t = {epoch.t:.2f} s"
