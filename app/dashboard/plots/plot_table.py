"""Table of plots: the plots of each tab. A new plot is a row here, with a function that draws it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from app.dashboard.plots import law_drawings, task_drawings
from app.dashboard.plots.charts import Plot
from app.dashboard.widgets.theorem.premise_table import premises_html
from app.session.snapshot import Snapshot

Chooser = Literal["coordinate", "joint"]


@dataclass(frozen=True)
class Tab:
    """Tab of the dock.
    plots: from top to bottom.
    choosers: above the plots.
    note: returns HTML that is shown above the plots, None for a tab without."""

    plots: tuple[Plot, ...]
    choosers: tuple[Chooser, ...] = ()
    note: Callable[[Snapshot], str] | None = None


TABS: dict[str, Tab] = {
    "Overview": Tab(
        (
            Plot("tracking error", task_drawings.tracking_error),
            Plot("force", task_drawings.force),
            Plot("bound of s", law_drawings.bound_of_s),
            Plot("gain", law_drawings.gain),
        )
    ),
    "Tracking": Tab(
        (
            Plot("position error", task_drawings.position_error),
            Plot("rotation error", task_drawings.rotation_error),
            Plot("one coordinate", task_drawings.one_coordinate),
        ),
        ("coordinate",),
    ),
    "Force": Tab(
        (
            Plot("normal force", task_drawings.normal_force),
            Plot("force error", task_drawings.force_error),
            Plot("force by axes", task_drawings.force_by_axes),
            Plot("moment by axes", task_drawings.moment_by_axes),
        )
    ),
    "Sliding": Tab(
        (
            Plot("reaching", law_drawings.reaching),
            Plot("Lyapunov function", law_drawings.lyapunov_function),
            Plot("components of s", law_drawings.components_of_s),
        ),
        note=law_drawings.reaching_note,
    ),
    "Guarantee": Tab(
        (
            Plot("gain by causes", law_drawings.gain_by_causes),
            Plot("perturbation", law_drawings.perturbation),
            Plot("margin", law_drawings.margin),
        ),
        note=premises_html,
    ),
    "Torque": Tab(
        (
            Plot("torques", law_drawings.torques),
            Plot("terms of a torque", law_drawings.terms_of_torque),
            Plot("robust terms", law_drawings.robust_terms),
        ),
        ("joint",),
    ),
    "Chattering": Tab(
        (Plot("spectrum", law_drawings.spectrum, spectral=True), Plot("variation", law_drawings.variation))
    ),
    "Residual": Tab(
        (Plot("residual", law_drawings.residual), Plot("norm of the residual", law_drawings.norm_of_residual))
    ),
}
