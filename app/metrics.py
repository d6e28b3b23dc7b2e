"""Figures about a run, from its recording."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from app.closed_loop import ClosedLoop

TAIL = 0.2  # share of the run that "tail" figures look at


class Metrics(Struct, frozen=True):
    """See each field; None where a figure has no meaning in the mode."""

    motion_error_tail: float  # max ||e|| of the position coordinates that are not force-controlled, m
    force_error_tail: float | None  # max |f_n - f_nd|, N
    constraint_violation: float | None  # max |phi| on a rigid surface, m
    reaching_time: float | None  # s; None while s has not been reached
    reaching_time_bound: float  # s, (18)
    envelope_violation: float  # max of ||s|| beyond (20) and the sampling band, m/s
    gain_condition_margin: float  # min of d minus what (17) needs, N
    target_model_residual_tail: float  # RMS of the left side of (8) minus its right side, N
    torque_total_variation: list[float]  # sum of |changes| per second, N m/s, per joint
    simulated_time: float  # s
    realtime_factor: float | None
    stopped: str | None


def measure(loop: ClosedLoop, realtime_factor: float | None = None) -> Metrics:
    """The figures of everything recorded so far. Raises ValueError for a run without a single step."""
    record = loop.recording.signals(tuple(loop.recording.columns))
    t = record["t"]
    if len(t) == 0:
        raise ValueError("metrics: nothing recorded yet")
    tail = t >= t[0] + (1.0 - TAIL) * (t[-1] - t[0])
    system = loop.system
    rigid = system.scenario.contact.kind == "rigid"
    tau = record["tau"]
    duration = max(float(t[-1] - t[0]), system.scenario.controller.period)
    excess = record["s_norm"] - record["s_bound"] - record["s_band"]
    return Metrics(
        motion_error_tail=float(np.linalg.norm(_motion_error(loop, record, tail), axis=1).max()),
        force_error_tail=float(np.abs(record["multiplier"] - record["F_cd"][:, 0])[tail].max()) if system.m else None,
        constraint_violation=float(np.abs(record["phi"]).max()) if rigid else None,
        reaching_time=loop.reaching_time,
        reaching_time_bound=loop.certificate.t_r,
        envelope_violation=max(float(excess.max()), 0.0),
        gain_condition_margin=float((record["d"] - record["d_required"]).min()),
        target_model_residual_tail=float(np.sqrt(np.mean(record["residual"][tail] ** 2))),
        torque_total_variation=[float(v) / duration for v in np.abs(np.diff(tau, axis=0)).sum(axis=0)],
        simulated_time=float(t[-1]) + system.scenario.controller.period,
        realtime_factor=realtime_factor,
        stopped=loop.stopped,
    )


def _motion_error(loop: ClosedLoop, record: dict[str, np.ndarray], tail: np.ndarray) -> np.ndarray:
    """The position errors (N, k) that a motion target governs: along the surface where there is one."""
    system = loop.system
    if system.layout.joint:
        return record["e_r"][tail]
    error = record["e_r"][tail][:, system.m : system.layout.positions]
    if system.m or system.scenario.contact.kind == "free":
        return error
    # Cartesian coordinates against a surface: the part along the normal is the force's business
    axes = system.charted.frame[: system.layout.positions]
    normals = np.array(
        [axes @ system.surface.chart(p, t).G[0] for p, t in zip(record["tool"][tail], record["t"][tail], strict=True)]
    )
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return error - normals * np.sum(error * normals, axis=1, keepdims=True)
