"""Metrics of a run, and accounts of stretches of runs, from recordings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from msgspec import Struct

from app.scenario.field_info import FieldInfo, infos_of
from app.scenario.units import Units
from app.simulation.closed_loop import ClosedLoop
from app.simulation.engines import Engine
from app.simulation.promise.verdict import Finding, PromiseVerdict
from app.simulation.recording import Epoch, Recording
from app.simulation.system import System
from environments.surfaces.table import Surface
from parameters import field

# signals of each surface
MULTIPLIERS, PHI = ("multiplier", "multiplier_2", "multiplier_3"), ("phi", "phi_2", "phi_3")
TAIL = 0.2  # share of the run, at its end, over which metrics with "tail" in their names are taken
LEAST_TAIL = 5  # rows, of which a shorter tail cannot tell whether a signal has settled
NORMALS = 300  # rows, about, in which the normals of a curved surface are computed; between them they vary smoothly
BAND = 0.02  # of the largest deviation, within which a signal counts as settled
THOUSANDTHS = ("m", "m/s", "rad")  # SI units of the metrics that are shown in mm, mm/s, mrad
DEPENDENT = 1e-6  # what is left of a unit normal that lies in the others' plane
FORCE_RESOLUTION, MOTION_RESOLUTION = 0.1, 5e-5  # N, m: the ripple of a settled loop is no transient


class Metrics(Struct, frozen=True):
    """Metrics of a run; None where a metric has no meaning in the mode or under the law, and for a time that has not
    come."""

    motion_error_tail: Annotated[
        float | None, field("largest position error where no force is controlled", "m", of="r")
    ]
    angle_error_tail: Annotated[float | None, field("largest error of angles and revolute supplemental joints", "rad")]
    force_error_tail: Annotated[float | None, field("largest force error", "N")]  # of several surfaces the norm
    moment_error_tail: Annotated[float | None, field("largest error of the moments of a flat tool", "N·m")]
    constraint_violation: Annotated[float | None, field("largest distance from a rigid surface", "m")]
    settling_time: Annotated[
        float | None,
        field(
            "until the force error, or without force control the path error, stays within 2 % of its largest deviation "
            "from its final value",
            "s",
        ),
    ]
    promise: PromiseVerdict
    premises: tuple[Finding, ...]
    reaching_time: Annotated[float | None, field("until ‖s‖ is within the boundary layer", "s")]
    reaching_time_bound: Annotated[float | None, field("t_r of (18), for s = 0, also where nothing is promised", "s")]
    layer_time_bound: Annotated[float | None, field("until ‖s‖ is within the boundary layer, as (20) promises", "s")]
    band_time: Annotated[float | None, field("until ‖s‖ is within its band", "s")]
    band_time_bound: Annotated[float | None, field("until ‖s‖ is within its band, as promised", "s")]
    envelope_violation: Annotated[
        float | None, field("largest ‖s‖ beyond (20) and the band, where they are promised", "m/s", of="r")
    ]
    gain_condition_margin: Annotated[float | None, field("least d minus what (17) needs", "N", of="r")]
    target_model_residual_tail: Annotated[float, field("RMS of the norm of the residual of (8)", "N", of="r")]
    torque_total_variation: Annotated[
        list[float], field("summed changes of each joint's commanded torque per second", "N·m/s", of="joints")
    ]
    saturated_share: Annotated[float, field("share of the control periods in which a drive is at its limit", "1")]
    simulated_time: Annotated[float, field("until the end of the run", "s")]
    realtime_factor: Annotated[float | None, field("simulated time per computing time", "1")]
    engine: Engine
    stopped: str | None


def metrics_of(loop: ClosedLoop, realtime_factor: float | None = None, engine: Engine = "pinocchio") -> Metrics:
    """Metrics of everything recorded so far. engine: that has computed the run. Raises ValueError for a run without a
    single step."""
    record = loop.recording.stretch()  # copies what is asked for only
    t = record["t"]
    if len(t) == 0:
        raise ValueError("metrics: nothing recorded yet")
    tail = tail_of(t)
    last = {name: record[name][tail] for name in ("t", "e_r", "tool", "F_c", "F_cd", *MULTIPLIERS)}
    system, begun = loop.system, loop.recording.epochs[0]
    rigid, robust = system.plant.nature.rigid, system.controller.law.robust
    layered = system.controller.has_layer
    excess = record["s_norm"] - record["s_bound"] - record["s_band"]
    promised = excess[np.isfinite(excess)]
    standing = loop.standing
    return Metrics(
        motion_error_tail=_largest(path_error(system, last)),
        angle_error_tail=_largest(angle_error(system, last)),
        force_error_tail=_largest(force_error(system, last) if system.m else None),
        moment_error_tail=float(moment_error(system, last).max()) if system.layout.tilts else None,
        constraint_violation=float(max(np.abs(record[name]).max() for name in PHI)) if rigid else None,
        settling_time=None if loop.stopped else _settling(system, record),
        promise=standing.run,
        premises=standing.findings_of_run,
        reaching_time=since(begun, begun.layer_reached) if layered else None,
        reaching_time_bound=begun.certificate.t_r if robust else None,
        layer_time_bound=since(begun, begun.layer_reached_by) if layered else None,
        band_time=since(begun, begun.band_reached),
        band_time_bound=since(begun, begun.band_reached_by),
        envelope_violation=max(float(promised.max()), 0.0) if len(promised) else None,
        gain_condition_margin=_least_margin(record),
        target_model_residual_tail=_rms(last["t"], np.linalg.norm(record["residual"][tail], axis=1)),
        torque_total_variation=_variation(t, record["tau"]).tolist(),
        saturated_share=float(np.average(saturated(record), weights=_durations(t))),
        simulated_time=float(t[-1]) + system.scenario.controller.period,
        realtime_factor=realtime_factor,
        engine=engine,
        stopped=loop.stopped,
    )


def _settling(system: System, record: Mapping[str, np.ndarray]) -> float | None:
    """Settling time of the force error, or of the path error where no force is controlled, s; None without an end."""
    if system.m:
        found = force_settling_time(system, record)
    else:
        path = path_error(system, record)
        found = math.inf if path is None else settling_time(record["t"], path, MOTION_RESOLUTION)
    return found if math.isfinite(found) else None


def force_settling_time(system: System, record: Mapping[str, np.ndarray]) -> float:
    """Settling time of the force error, s; infinite where a surface that is to be pressed is not touched at the end."""
    tail = tail_of(record["t"])
    for i, name in enumerate(MULTIPLIERS[: system.pressed]):
        if record["F_cd"][tail, i].any() and not record[name][tail].any():
            return math.inf
    return settling_time(record["t"], force_error(system, record), FORCE_RESOLUTION)


def untouched_sentences(system: System, recording: Recording) -> list[str]:
    """Sentences on the surfaces that are to be pressed and that the tool has not touched in the whole run, each with
    the distance and the position of the tool at its beginning; none for a surface whose desired force is always 0."""
    record, sentences = recording.stretch(), list[str]()
    for i, name in enumerate(MULTIPLIERS[: system.pressed]):
        if record[name].any() or not record["F_cd"][:, i].any():
            continue
        which = "the surface" if i == 0 else f"surface {i + 1}"
        place = ", ".join(f"{x + 0.0:.4g}" for x in record["tool"][0])
        sentences.append(
            f"the tool has not touched {which}; it began {-record[PHI[i]][0]:.2g} m away, at [{place}] in the world"
        )
    return sentences


def _least_margin(record: Mapping[str, np.ndarray]) -> float | None:
    """Least d minus what (17) needs, N, over the rows whose law has a gain d."""
    under = record["d"] > 0.0
    return float((record["d"] - record["d_required"])[under].min()) if under.any() else None


def since(epoch: Epoch, instant: float | None) -> float | None:
    """Time (s) of an instant (s), counted from the epoch's beginning."""
    return None if instant is None else instant - epoch.t


def tail_of(t: np.ndarray) -> np.ndarray:
    """Mask (N,) bool of the times t (N,) s that belong to the tail."""
    return t >= t[-1] - TAIL * (t[-1] - t[0])


def saturated(record: Mapping[str, np.ndarray]) -> np.ndarray:
    """Mask (N,) bool of the rows in which a drive's limit cuts the torque; no limit cuts one that is no number."""
    tau = record["tau"]
    return ((record["tau_applied"] != tau) & ~np.isnan(tau)).any(axis=1)


def force_error(system: System, record: Mapping[str, np.ndarray]) -> np.ndarray:
    """Force error f_n - f_nd, (N,) N, of a mode that controls a force; on several surfaces the norm of their errors."""
    errors = [record[name] - record["F_cd"][:, i] for i, name in enumerate(MULTIPLIERS[: system.pressed])]
    return errors[0] if len(errors) == 1 else np.linalg.norm(errors, axis=0)


def moment_error(system: System, record: Mapping[str, np.ndarray]) -> np.ndarray:
    """Norm (N,) N m of the error of a flat tool's moments, as measured; F_c has them over l."""
    tilts = slice(system.pressed, system.m)
    return system.layout.l * np.linalg.norm(record["F_c"][:, tilts] - record["F_cd"][:, tilts], axis=1)


def motion_error(system: System, record: Mapping[str, np.ndarray]) -> np.ndarray:
    """Position errors (N, k) m that a motion target governs: along the surfaces that are touched, and of supplemental
    joints that are prismatic."""
    if system.layout.joint:
        return record["e_r"]
    return np.hstack([_tool_error(system, record), record["e_r"][:, after_positions(system, angles=False)]])


def after_positions(system: System, *, angles: bool) -> list[int]:
    """Coordinates behind the tool's position: its angles and revolute supplemental joints, or the prismatic ones."""
    after = range(system.layout.end_of_positions, system.layout.n)
    return [i for i in after if system.coordinates[i].is_angle == angles]


def _tool_error(system: System, record: Mapping[str, np.ndarray]) -> np.ndarray:
    """Errors (N, k) m of the tool's position, as in `motion_error`."""
    error = record["e_r"][:, system.m : system.layout.end_of_positions]
    if system.m or not system.plant.nature.touches or system.mode.feedback == "none":
        return error  # also against a surface that the mode does not know of
    # Cartesian coordinates against surfaces: the part along the normals is the force's business, where there is a force
    axes, directions = system.charted.frame[: system.layout.positions], list[np.ndarray]()
    for surface, name in zip(system.surfaces, MULTIPLIERS, strict=False):
        touched = np.flatnonzero(record[name])
        normals = np.zeros_like(error)
        normals[touched] = _normals(surface, record["tool"][touched], record["t"][touched]) @ axes.T
        for direction in directions:  # normals of several surfaces need not be orthogonal
            normals -= direction * (direction * normals).sum(axis=1, keepdims=True)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        direction = np.divide(normals, length, out=np.zeros_like(normals), where=length > DEPENDENT)
        error = error - direction * (direction * error).sum(axis=1, keepdims=True)
        directions.append(direction)
    return error


def _normals(surface: Surface, places: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Unit normals (N, 3) of a surface at places (N, 3) m and times t (N,) s that follow each other: of many, those
    between computed ones are interpolated."""
    if len(t) == 0 or surface.form.normal_fixed:
        return np.broadcast_to(surface.frame[0], (len(t), 3))
    rows = np.unique(np.linspace(0, len(t) - 1, min(len(t), NORMALS)).round().astype(int))
    known = np.array([surface.chart(places[row], float(t[row])).G[0] for row in rows])
    found = np.stack([np.interp(np.arange(len(t)), rows, column) for column in known.T], axis=1)
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def path_error(system: System, record: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Path error (N,) m: norm of `motion_error`; None where the surfaces leave no position free."""
    errors = motion_error(system, record)
    return np.linalg.norm(errors, axis=1) if errors.shape[1] else None


def angle_error(system: System, record: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Norm (N,) rad of the errors of the angles and revolute supplemental joints, which e_r has times l; None where
    there are none beside the positions, and where r = q, whose errors are all in `motion_error`. Tilts of a flat tool
    are no part of it: their moments are controlled."""
    angles = [] if system.layout.joint else after_positions(system, angles=True)
    return np.linalg.norm(record["e_r"][:, angles], axis=1) / system.layout.l if angles else None


def settling_time(t: np.ndarray, signal: np.ndarray, resolution: float) -> float:
    """Settling time: s from t[0] until the signal (N,) stays within `BAND` of its largest deviation from its final
    value.
    The final value is the mean of the tail. Deviations smaller than `resolution` do not count. Infinite when the signal
    has not settled by the tail, is not finite, or is too short to tell."""
    tail = tail_of(t)
    if tail.sum() < LEAST_TAIL or not np.isfinite(signal).all():
        return math.inf
    away = np.abs(signal - signal[tail].mean())
    outside = np.flatnonzero(away > max(BAND * float(away.max()), resolution))
    if not len(outside):
        return 0.0
    return math.inf if tail[outside[-1]] else float(t[outside[-1] + 1] - t[0])


class Account(Struct, frozen=True):
    """Account of a stretch of a run: numbers for comparing runs, None where one has no meaning in the mode."""

    path_rms: Annotated[float | None, field("RMS of the position error that a motion target governs", "m", of="r")]
    path_max: Annotated[float | None, field("largest position error that a motion target governs", "m", of="r")]
    angle_rms: Annotated[
        float | None, field("RMS of the error of angles and revolute supplemental joints that follow a path", "rad")
    ]
    angle_max: Annotated[
        float | None, field("largest error of angles and revolute supplemental joints that follow a path", "rad")
    ]
    force_rms: Annotated[float | None, field("RMS of the force error", "N")]
    force_max: Annotated[float | None, field("largest force error", "N")]
    s_max: Annotated[float | None, field("largest ‖s‖ under a law with the gain d", "m/s", of="r")]
    residual_rms: Annotated[float, field("RMS of the norm of the residual of (8)", "N", of="r")]
    effort: Annotated[float, field("RMS of the norm of the applied torques", "N·m", of="joints")]
    variation: Annotated[float, field("summed changes of all commanded torques per second", "N·m/s", of="joints")]
    gain_margin: Annotated[float | None, field("least d minus what (17) needs", "N", of="r")]


@dataclass(frozen=True)
class ShownMetric:
    """Metric of an `Account` or of `Metrics` as it is shown, in a unit that depends on the task space.
    field: its name there.
    percent: whether it is a share that is shown in percent."""

    struct: type[Account | Metrics]
    field: str
    title: str
    percent: bool = False

    @property
    def info(self) -> FieldInfo:
        return infos_of(self.struct)[self.field]

    @property
    def factor(self) -> float:
        """How many of the shown unit make one SI unit."""
        return 100.0 if self.percent else 1e3 if self.info.unit in THOUSANDTHS else 1.0

    def unit(self, units: Units) -> str:
        """Unit in which the metric is shown in a task space with these units, "" for a plain number."""
        if self.percent:
            return "%"
        si = self.info.unit
        return replace(self.info, unit=f"m{si}" if si in THOUSANDTHS else si).unit_in(units)

    def of(self, account: Account | Metrics | None) -> float | None:
        """Value of the metric in the unit in which it is shown; None where it has none, or no finite one."""
        value: float | None = None if account is None else getattr(account, self.field)
        if value is None or not math.isfinite(value):
            return None
        return value * self.factor + 0.0  # no "-0"

    def units(self, systems: Iterable[System]) -> str:
        """Unit of the metric in runs of these systems; both units where they differ."""
        return " or ".join(dict.fromkeys(self.unit(system.units) for system in systems))


ACCOUNT_METRICS = (
    ShownMetric(Account, "path_rms", "path error, RMS"),
    ShownMetric(Account, "path_max", "path error, largest"),
    ShownMetric(Account, "angle_rms", "angle error, RMS"),
    ShownMetric(Account, "angle_max", "angle error, largest"),
    ShownMetric(Account, "force_rms", "force error, RMS"),
    ShownMetric(Account, "force_max", "force error, largest"),
    ShownMetric(Account, "s_max", "‖s‖, largest"),
    ShownMetric(Account, "residual_rms", "residual of (8), RMS"),
    ShownMetric(Account, "effort", "torque ‖τ‖, RMS"),
    ShownMetric(Account, "variation", "torque variation"),
    ShownMetric(Account, "gain_margin", "least margin of (17)"),
)
# those of a whole run; the torques' variation, a number per joint, stands beside them
RUN_METRICS = (
    ShownMetric(Metrics, "motion_error_tail", "path error at the end, largest"),
    ShownMetric(Metrics, "angle_error_tail", "angle error at the end, largest"),
    ShownMetric(Metrics, "force_error_tail", "force error at the end, largest"),
    ShownMetric(Metrics, "moment_error_tail", "moment error at the end, largest"),
    ShownMetric(Metrics, "constraint_violation", "distance from the rigid surface, largest"),
    ShownMetric(Metrics, "settling_time", "settled after"),
    ShownMetric(Metrics, "band_time", "band reached after"),
    ShownMetric(Metrics, "band_time_bound", "band promised within"),
    ShownMetric(Metrics, "reaching_time", "boundary layer reached after"),
    ShownMetric(Metrics, "layer_time_bound", "boundary layer promised within"),
    ShownMetric(Metrics, "reaching_time_bound", "s = 0 by (18), promised or not"),
    ShownMetric(Metrics, "envelope_violation", "‖s‖ beyond (20) and the band, largest"),
    ShownMetric(Metrics, "gain_condition_margin", "least margin of (17)"),
    ShownMetric(Metrics, "target_model_residual_tail", "residual of (8) at the end, RMS"),
    ShownMetric(Metrics, "saturated_share", "time with a drive at its limit", percent=True),
    ShownMetric(Metrics, "simulated_time", "simulated time"),
    ShownMetric(Metrics, "realtime_factor", "simulated time per computing time"),
)


def account(system: System, recording: Recording, t_from: float, t_to: float) -> Account | None:
    """Account of the rows with t_from <= t <= t_to (s), None for fewer than two of them."""
    record = recording.stretch(t_from, t_to)  # copies what is asked for only
    t = record["t"]
    if len(t) < 2:
        return None
    path = path_error(system, record)
    angles, force = angle_error(system, record), force_error(system, record) if system.m else None
    return Account(
        path_rms=None if path is None else _rms(t, path),
        path_max=_largest(path),
        angle_rms=None if angles is None else _rms(t, angles),
        angle_max=_largest(angles),
        force_rms=None if force is None else _rms(t, force),
        force_max=_largest(force),
        s_max=float(record["s_norm"][gained].max()) if (gained := record["d"] > 0.0).any() else None,
        residual_rms=_rms(t, np.linalg.norm(record["residual"], axis=1)),
        effort=_rms(t, np.linalg.norm(record["tau_applied"], axis=1)),
        variation=float(_variation(t, record["tau"]).sum()),
        gain_margin=_least_margin(record),
    )


def _largest(errors: np.ndarray | None) -> float | None:
    """Size of the largest of these errors, None where there are none."""
    return None if errors is None else float(np.abs(errors).max())


def _rms(t: np.ndarray, values: np.ndarray) -> float:
    return float(np.sqrt(np.average(values**2, weights=_durations(t))))


def _durations(t: np.ndarray) -> np.ndarray:
    """Time (N,) s that each of the rows at t (N,) s stands for: more where a long recording was thinned."""
    return np.diff(t, append=2.0 * t[-1] - t[-2]) if len(t) > 1 else np.ones(len(t))


def _variation(t: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Sum of the |changes| per second of each column of tau (N, n), (n,): of the rows with the shortest interval, since
    changes between rows that were thinned out are lost."""
    if len(t) < 2:
        return np.zeros(tau.shape[1])
    steps = np.diff(t)
    kept = steps < 1.5 * steps.min()
    return np.abs(np.diff(tau, axis=0))[kept].sum(axis=0) / steps[kept].sum()
