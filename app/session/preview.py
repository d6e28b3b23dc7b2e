"""Preview (what if): the next seconds of a run under an edited scenario, from its present state; no thread, no screen,
no file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from msgspec import Struct

from app.analysis.metrics import force_error, motion_error, settling_time, steady_force_error, tail_of
from app.scenario.schema import Scenario
from app.simulation.closed_loop import ClosedLoop
from app.simulation.recording import Epoch
from app.simulation.search_memory import Memory
from app.simulation.state import State
from app.simulation.system import System

POINTS = 200  # about the number of pixels that a plot has ahead of now
FORCE_RESOLUTION, MOTION_RESOLUTION = 0.1, 5e-5  # N, m: the ripple of a settled loop is no transient
STEADY = 1e-6  # N, by which a constant desired force may vary in the tail


@dataclass(frozen=True)
class Question:
    """Request for a preview: the next `horizon` s from `state` on under `scenario`. Numbers grow.
    partial: an intermediate answer is wanted, too, and given even when a newer question is waiting."""

    number: int
    state: State
    scenario: Scenario
    horizon: float
    partial: bool = True


class Figures(Struct, frozen=True):
    """Figures of a preview: final values, as far as it reaches; None where a figure has no meaning in the mode, inf for
    never."""

    span: float  # s ahead of now that these figures look at
    force_error: float | None  # mean of f_n - f_nd over the tail, N
    force_error_predicted: float | None  # the same by (37), for a constant desired force, N
    force_settling: float | None  # s, see `metrics.settling_time`
    motion_error: float  # largest in the tail, m
    motion_settling: float  # s
    reaching_time: float  # of s, s
    reaching_time_promised: float  # (18), s
    gain_margin: float  # smallest d minus what (17) needs, N
    left: str | None  # how and when it leaves the theorem's domain


@dataclass(frozen=True)
class Outlook:
    """Answer to a question, or the beginning of one unless `whole`.
    ahead: (N,) s after now.
    signals: those of a recording, at these instants.
    epochs: those that the signals were computed under.
    restarts: the edit begins the scenario anew."""

    number: int
    scenario: Scenario
    ahead: np.ndarray
    signals: dict[str, np.ndarray]
    epochs: tuple[Epoch, ...]
    figures: Figures
    whole: bool
    restarts: bool


@dataclass(frozen=True)
class Refusal:
    """Refusal of a question whose scenario cannot be used; one sentence."""

    number: int
    sentence: str


@dataclass(frozen=True)
class Hurry:
    """Message to the preview process: a newer question is waiting, or no answer is wanted any more."""


@dataclass(frozen=True)
class Done:
    """Message from the preview process: ready for the next question."""


class Foresight:
    """A run of its own that answers a question, piece by piece.

    Takes over what is the same from `previous`, and what `memory` knows. Raises ScenarioError when the edited scenario
    cannot be built.
    """

    def __init__(self, question: Question, previous: System | None = None, memory: Memory | None = None) -> None:
        self.question = question
        rows = max(1, round(question.horizon / question.scenario.controller.period))
        self._loop = ClosedLoop.resume(question.state, rows, previous, memory)
        self.base = self._loop.system  # of the running scenario: a good `previous` for the next question
        if question.scenario != question.state.scenario:
            self._loop.edit(question.scenario)
        self._start, self._rows, self._points = self._loop.t, rows, _points(rows)

    @property
    def share(self) -> float:
        """Share of the horizon that is computed, 0 to 1; 1 for a run that has stopped."""
        return 1.0 if self._loop.stopped else len(self._loop.recording) / self._rows

    def advance(self, steps: int) -> None:
        """Compute that many control periods, or up to the horizon."""
        loop = self._loop
        for _ in range(min(steps, self._rows - len(loop.recording))):
            loop.advance()

    def outlook(self) -> Outlook | Refusal:
        """Outlook of what has been computed so far."""
        number, recording = self.question.number, self._loop.recording
        if not len(recording):
            return Refusal(number, f"nothing lies ahead: {self._loop.stopped or 'no control period is computed yet'}")
        record = recording.signals(tuple(recording.columns))
        points = self._points[self._points < len(recording)]
        signals = {name: values[points] for name, values in record.items()}
        return Outlook(
            number,
            self.question.scenario,
            signals["t"] - self._start,
            signals,
            tuple(recording.epochs),
            self._figures(record, signals),
            whole=self.share >= 1.0,
            restarts=self._start != self.question.state.t,
        )

    def _figures(self, record: dict[str, np.ndarray], thinned: dict[str, np.ndarray]) -> Figures:
        loop, system, t = self._loop, self._loop.system, record["t"]
        tail = tail_of(t)
        path = np.linalg.norm(_path_error(system, thinned), axis=1)
        error = predicted = settling = None
        if system.m:
            deviation, f_nd = force_error(record), record["F_cd"][tail, 0]
            error = float(deviation[tail].mean())
            s = record["s"][tail].mean(axis=0)
            predicted = steady_force_error(system, float(f_nd[-1]), s) if np.ptp(f_nd) < STEADY else None
            settling = settling_time(t, deviation, FORCE_RESOLUTION)
        return Figures(
            span=float(t[-1] - self._start) + system.scenario.controller.period,
            force_error=error,
            force_error_predicted=predicted,
            force_settling=settling,
            motion_error=float(path[tail_of(thinned["t"])].max()),
            motion_settling=settling_time(thinned["t"], path, MOTION_RESOLUTION),
            reaching_time=np.inf if loop.reaching_time is None else loop.reaching_time,
            reaching_time_promised=loop.certificate.t_r,
            gain_margin=float((record["d"] - record["d_required"]).min()),
            left=loop.stopped or loop.warning or _unpromised(loop),
        )


def _unpromised(loop: ClosedLoop) -> str | None:
    """Reason why nothing is promised at the end; None where something is."""
    promise = loop.standing.now
    return None if promise.verdict == "holds" else f"{promise.verdict}: {promise.because}"


def _path_error(system: System, record: dict[str, np.ndarray]) -> np.ndarray:
    """Position errors (N, k) m as plots show them: where no force is controlled, also those into a surface."""
    if system.m or system.layout.joint:
        return motion_error(system, record)
    return record["e_r"][:, : system.layout.positions]


def _points(rows: int) -> np.ndarray:
    """Indices of the drawn rows, of so many rows: half of the points evenly spaced, half ever closer towards now, where
    the response to an edit is fast. Without the very first row, where "no reaching transient" makes s exactly 0, which
    no logarithmic axis can show."""
    if rows < 3:
        return np.arange(rows)
    even, close = np.linspace(1, rows - 1, POINTS // 2), np.geomspace(1, rows - 1, POINTS // 2)
    return np.unique(np.concatenate([even, close]).astype(int))
