"""Present state of a loop as a screen shows it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from app.simulation.period.control_period import Evaluation
from controllers.premises import Premise
from kernels.records import Record

if TYPE_CHECKING:
    from app.simulation.closed_loop import ClosedLoop


@dataclass(frozen=True)
class View:
    """Present state of a loop for drawing and reading.
    q: (n,) rad.
    tool, tool_desired: (3,) m, the latter None in joint space.
    force, force_desired: (3,) N, of the tool on the surface.
    push, push_moment: (3,) N and (3,) N m, of a hand, or of truth.push, on the tool.
    metrics: numbers of this instant."""

    q: np.ndarray
    tool: np.ndarray
    tool_desired: np.ndarray | None
    force: np.ndarray
    force_desired: np.ndarray
    push: np.ndarray
    push_moment: np.ndarray
    metrics: LiveMetrics

    @property
    def live(self) -> dict[str, float]:
        """See `LiveMetrics.numbers`."""
        return self.metrics.numbers


@dataclass(frozen=True)
class LiveMetrics:
    """Metrics of one instant, computed when they are first read: a picture of the arm needs none of them.
    evaluation: of the control period that begins then, in memory of its own.
    residual: (n,).
    t_r, reaching_time: promised and measured, s, nan for none.
    force_factor: of the sampled loop."""

    evaluation: Record[Evaluation]
    residual: np.ndarray
    t_r: float
    reaching_time: float
    force_factor: float

    @cached_property
    def numbers(self) -> dict[str, float]:
        """Numbers by name, SI units: s_norm, s_bound, s_band, d, d_required, gain_margin, sigma_min, V, residual,
        layer_loop_factor, force_loop_factor, reaching_time_bound, reaching_time."""
        evaluation = self.evaluation.read()
        task, output = evaluation.seen.task, evaluation.output
        required = float(sum(output.needed))
        H_hat = task.J_q_inv.T @ evaluation.seen.estimate.M_hat @ task.J_q_inv
        table = evaluation.table
        return {
            "s_norm": output.s_norm,
            "s_bound": evaluation.promise_record.bound,
            "s_band": evaluation.promise_record.band,
            "d": output.d,
            "d_required": required,
            "gain_margin": output.d - required,
            "sigma_min": 1.0 / task.J_q_inv_norm,
            "V": float(0.5 * output.s @ H_hat @ output.s),
            "residual": float(np.linalg.norm(self.residual)),
            "reaching_time_bound": self.t_r,
            "reaching_time": self.reaching_time,
            "layer_loop_factor": table.value[Premise.LAYER] if table.applies(Premise.LAYER) else np.nan,
            "force_loop_factor": self.force_factor,
        }


def view_of(loop: ClosedLoop) -> View:
    """View of the present state of a loop."""
    system, state = loop.system, loop.state
    arm, evaluated = state.arm.views, loop.evaluated()
    seen, reference = evaluated.data["seen"], evaluated.data["reference"]
    normals = seen["task"]["normals"][0]
    metrics = LiveMetrics(
        evaluated,
        state.evaluation.views.residual.copy(),
        loop.certificate.t_r,
        np.nan if loop.reaching_time is None else loop.reaching_time,
        loop.sampled.force_factor,
    )
    push = loop.controlled_arm.push
    return View(
        arm.q.copy(),
        seen["estimate"]["p"][0],
        None if system.layout.joint else system.tool_at(reference["r_d"][0], state.t),
        arm.load.wrench[:3].copy(),
        reference["F_cd"][0, : system.pressed] @ normals[: system.pressed],
        push[:3].copy(),
        push[3:].copy(),
        metrics,
    )
