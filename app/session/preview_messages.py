"""Messages between the page and the process that computes previews: requests, previews with their metrics, refusals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from msgspec import Struct

from app.scenario.schema import Scenario
from app.session.arm_band import ArmBand
from app.simulation.recording import Epoch
from app.simulation.state import State


@dataclass(frozen=True)
class PreviewRequest:
    """Request to the preview process: what are the next `horizon` s from `state` on under `scenario`?
    number: larger than that of every earlier request.
    partial: whether an intermediate answer is wanted, too; it is given even when a newer request is waiting.
    push: N, of a push on the tool where nothing else would move the arm; 0 for none.
    compared: whether the metrics of the running scenario are wanted, too.
    arms: number of true arms, drawn from the declared set, whose band is wanted."""

    number: int
    state: State
    scenario: Scenario
    horizon: float
    partial: bool = True
    push: float = 0.0
    compared: bool = False
    arms: int = 0


class PreviewMetrics(Struct, frozen=True):
    """Metrics of a preview, over the time that it reaches; None where a metric has no meaning in the mode, inf for
    never.
    span: s ahead of now, over which they are taken.
    push: of the push where nothing else moves the arm, N; 0 where there is none.
    force_error: mean of f_n - f_nd over the tail, N.
    force_error_predicted: that error by (37), for a constant desired force, N.
    force_settling: s, see `metrics.settling_time`.
    force_overshoot: how far the force goes beyond its final value, seen from its beginning, N; to either side where it
        begins at that value.
    contact_largest: largest force on the surfaces, N.
    contact_final: mean of that force over the tail where it is not controlled, N.
    motion_largest: largest position error, m; None where no position is free.
    motion_grows: whether that is the last one, after a tail in which it has grown.
    motion_error: largest position error in the tail, m.
    motion_settling: of the position error, s.
    motion_overshoot: how far the position error goes to the other side after its largest value, m.
    angle_largest: largest error of the angles, rad; None where they neither yield nor follow a path.
    angle_error: largest error of the angles in the tail, rad.
    torque_largest: largest torque of any joint, as applied, N m.
    reaching_time: s, until s is reached; None under a law without the gain d.
    reaching_time_promised: (18), s; None where nothing is promised.
    gain_margin: smallest d minus what (17) needs, N; None under such a law.
    left: how and when the run leaves the theorem's domain."""

    span: float
    push: float
    force_error: float | None
    force_error_predicted: float | None
    force_settling: float | None
    force_overshoot: float | None
    contact_largest: float | None
    contact_final: float | None
    motion_largest: float | None
    motion_grows: bool
    motion_error: float | None
    motion_settling: float | None
    motion_overshoot: float | None
    angle_largest: float | None
    angle_error: float | None
    torque_largest: float
    reaching_time: float | None
    reaching_time_promised: float | None
    gain_margin: float | None
    left: str | None


@dataclass(frozen=True)
class Preview:
    """Preview: the answer to a request, or the beginning of one.
    number: of the request.
    since: s, the instant of the request, or the start where the edit begins the scenario anew.
    signals: those of a recording, at (N,) instants after that; epochs: of those rows.
    whole: whether the answer reaches as far as the request.
    restarts: whether the edit begins the scenario anew.
    today: metrics of the running scenario; None until they are known.
    band: of true arms, as far as it is known; None while nothing is. bandless: why there will be none, else ""."""

    number: int
    scenario: Scenario
    since: float
    signals: dict[str, np.ndarray]
    epochs: tuple[Epoch, ...]
    metrics: PreviewMetrics
    whole: bool
    restarts: bool
    today: PreviewMetrics | None = None
    band: ArmBand | None = None
    bandless: str = ""

    @property
    def ahead(self) -> np.ndarray:
        """Instants (N,) of the signals, s after `since`."""
        return self.signals["t"] - self.since

    def follows(self, t: float) -> bool:
        """Whether the preview was requested at t (s) of the run or before; not where somebody has looked back since."""
        return self.restarts or self.since < t + 0.5 * self.scenario.controller.period


@dataclass(frozen=True)
class PreviewRefusal:
    """Refusal of a request whose scenario cannot be used; one sentence."""

    number: int
    sentence: str


@dataclass(frozen=True)
class Hurry:
    """Message to the preview process: a newer request is waiting, or no answer is wanted any more."""


@dataclass(frozen=True)
class PreviewDone:
    """Message from the preview process: ready for the next request."""
