"""Metrics of a run, and accounts of stretches of runs, from recordings."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from msgspec import Struct

from app.scenario.units import Units
from app.simulation.closed_loop import ClosedLoop
from app.simulation.engines import Engine
from app.simulation.promise.verdict import Finding, PromiseVerdict
from app.simulation.recording import Epoch, Recording
from app.simulation.system import System
from environments.surfaces.table import Surface

# signals of each surface
MULTIPLIERS, PHI = ("multiplier", "multiplier_2", "multiplier_3"), ("phi", "phi_2", "phi_3")
TAIL = 0.2  # share of the run, at its end, over which metrics with "tail" in their names are taken
LEAST_TAIL = 5  # rows, of which a shorter tail cannot tell whether a signal has settled
NORMALS = 300  # rows, about, in which the normals of a curved surface are computed; between them they vary smoothly
BAND = 0.02  # of the largest deviation, within which a signal counts as settled
DEPENDENT = 1e-6  # what is left of a unit normal that lies in the others' plane
FORCE_RESOLUTION, MOTION_RESOLUTION = 0.1, 5e-5  # N, m: the ripple of a settled loop is no transient


class Metrics(Struct, frozen=True):
    """Metrics of a run, see each field; None where a metric has no meaning in the mode."""

    motion_error_tail: float | None  # max ||e|| of the position coordinates that are not force-controlled, m
    angle_error_tail: float | None  # max ||e|| of the angles and revolute supplemental joints that follow a path, rad
    force_error_tail: float | None  # max |f_n - f_nd|, of several surfaces the norm, N
    moment_error_tail: float | None  # max ||m - m_d|| of a flat tool, as measured, N m
    constraint_violation: float | None  # max |phi| on rigid surfaces, m
    settling_time: (
        float | None
    )  # s, of the force, or of the path where none is controlled; None while it is not settled
    promise: PromiseVerdict
    premises: tuple[Finding, ...]
    reaching_time: (
        float | None
    )  # s, until ||s|| is within the boundary layer; None while it is not, and for a law that has none
    reaching_time_bound: float | None  # s, (18): until s = 0 in continuous time, and so until the layer
    layer_time_bound: float | None  # s, until the boundary layer; None for a law that has none
    band_time: float | None  # s, until ||s|| is within its band
    band_time_bound: float | None  # s
    envelope_violation: float | None  # max of ||s|| beyond (20) and the band where they are promised, m/s
    gain_condition_margin: float | None  # min of d minus what (17) needs, N; None under a law without the gain d
    target_model_residual_tail: float  # RMS of the norm of (8)'s left side minus its right side, N
    torque_total_variation: list[float]  # sum of |changes| per second, N m/s, per joint
    saturated_share: float  # of the control periods, in which a drive's limit cuts the torque
    simulated_time: float  # s
    realtime_factor: float | None
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

    path_rms: float | None  # of the position error that a motion target governs, m
    path_max: float | None  # m
    angle_rms: float | None  # of the error of the angles and revolute supplemental joints that follow a path, rad
    angle_max: float | None  # rad
    force_rms: float | None  # of f_n - f_nd, N
    force_max: float | None  # N
    s_max: float | None  # of ||s||, m/s, under a law with the gain d; None without one, where s means nothing
    residual_rms: float  # of the norm of the residual of the target model (8), N
    effort: float  # RMS of ||tau|| as applied, N m
    variation: float  # of the commanded torques: sum of their |changes| per second, N m/s
    gain_margin: float | None  # least d minus what (17) needs, N; None under a law without d


@dataclass(frozen=True)
class ShownMetric:
    """Metric: a number of an `Account` or of `Metrics` as it is shown, in a unit that depends on the task space, and of
    which `factor` make one SI unit."""

    title: str
    field: str
    factor: float
    unit: Callable[[Units], str]

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
    ShownMetric("path error, RMS", "path_rms", 1e3, lambda units: units.error),
    ShownMetric("path error, largest", "path_max", 1e3, lambda units: units.error),
    ShownMetric("angle error, RMS", "angle_rms", 1e3, lambda _: "mrad"),
    ShownMetric("angle error, largest", "angle_max", 1e3, lambda _: "mrad"),
    ShownMetric("force error, RMS", "force_rms", 1.0, lambda _: "N"),
    ShownMetric("force error, largest", "force_max", 1.0, lambda _: "N"),
    ShownMetric("‖s‖, largest", "s_max", 1e3, lambda units: units.rate),
    ShownMetric("residual of (8), RMS", "residual_rms", 1.0, lambda units: units.force),
    ShownMetric("torque ‖τ‖, RMS", "effort", 1.0, lambda units: units.of_joints("N·m")),
    ShownMetric("torque variation", "variation", 1.0, lambda units: units.of_joints("N·m/s")),
    ShownMetric("least margin of (17)", "gain_margin", 1.0, lambda units: units.force),
)
# those of a whole run; the torques' variation, a number per joint, stands beside them
RUN_METRICS = (
    ShownMetric("path error at the end, largest", "motion_error_tail", 1e3, lambda units: units.error),
    ShownMetric("angle error at the end, largest", "angle_error_tail", 1e3, lambda _: "mrad"),
    ShownMetric("force error at the end, largest", "force_error_tail", 1.0, lambda _: "N"),
    ShownMetric("moment error at the end, largest", "moment_error_tail", 1.0, lambda _: "N·m"),
    ShownMetric("distance from the rigid surface, largest", "constraint_violation", 1e3, lambda _: "mm"),
    ShownMetric("settled after", "settling_time", 1.0, lambda _: "s"),
    ShownMetric("band reached after", "band_time", 1.0, lambda _: "s"),
    ShownMetric("band promised within", "band_time_bound", 1.0, lambda _: "s"),
    ShownMetric("boundary layer reached after", "reaching_time", 1.0, lambda _: "s"),
    ShownMetric("boundary layer promised within", "layer_time_bound", 1.0, lambda _: "s"),
    ShownMetric("s = 0 by (18), promised or not", "reaching_time_bound", 1.0, lambda _: "s"),
    ShownMetric("‖s‖ beyond (20) and the band, largest", "envelope_violation", 1e3, lambda units: units.rate),
    ShownMetric("least margin of (17)", "gain_condition_margin", 1.0, lambda units: units.force),
    ShownMetric("residual of (8) at the end, RMS", "target_model_residual_tail", 1.0, lambda units: units.force),
    ShownMetric("time with a drive at its limit", "saturated_share", 100.0, lambda _: "%"),
    ShownMetric("simulated time", "simulated_time", 1.0, lambda _: "s"),
    ShownMetric("simulated time per computing time", "realtime_factor", 1.0, lambda _: ""),
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
