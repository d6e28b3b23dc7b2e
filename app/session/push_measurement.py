"""Measurement of the tool's admittance by pushes: from a state of a run on, runs with all that a linear prediction
leaves out.

Each push is simulated, and the same run without it. Only the differences count, so that other causes of motion (the end
of a path, a moving surface, the sensor's noise) cancel. The reference is held where it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import msgspec
import numpy as np
import pinocchio as pin

from app.scenario.errors import ScenarioError
from app.scenario.schema import Declared
from app.session.headless_run import play
from app.simulation.assembly import assemble
from app.simulation.builders.controller_builder import law_of, mode_of
from app.simulation.closed_loop import ClosedLoop
from app.simulation.engines import Engine
from app.simulation.omega.search_memory import Memory
from app.simulation.sampled_loop.push_response import FORCE, RIGID, PushAxis, PushResponse
from app.simulation.state import State, blending
from app.simulation.system import System
from environments.push import TimedPush

SETTLES = 0.5  # s, before the push begins
LEAD, CYCLES = 1.5, 5  # s under a sine before it counts, and whole cycles that count
RESTS = 2.0  # s after a chirp, in which the tool comes to rest
SHORTEST, LONGEST = 4, 60.0  # control periods in the shortest cycle, and s of the longest one
NEWTONS, NEWTON_METRES = 2.0, 0.1
NEAR = 1e-6  # m, from a surface, within which the tool begins on it
FAR = 0.05  # of the predicted admittance: farther away, a point needs an explanation


class Measured(NamedTuple):
    """Measured admittance at one frequency (Hz).
    admittance: (p, p), complex: of the speed along each axis by a push along each, see `PushResponse`."""

    frequency: float
    admittance: np.ndarray


class Chirp(NamedTuple):
    """Chirp: a push whose frequency goes from `low` to `high` (Hz) in `seconds` s, evenly in the logarithm. points:
    number of frequencies at which it is evaluated."""

    low: float = 0.3
    high: float = 100.0
    seconds: float = 10.0
    points: int = 14


class PushExperiment:
    """Runs from one state on, with a push along each axis: `newtons` N, or a moment of `newton_metres` N m.
    engine: computes the runs, None for the one in force."""

    def __init__(
        self,
        state: State,
        axes: Sequence[PushAxis],
        newtons: float = NEWTONS,
        newton_metres: float = NEWTON_METRES,
        memory: Memory | None = None,
        engine: Engine | None = None,
    ) -> None:
        self._state, self._axes = replace(state.copy(), grip=None), axes
        self._engine: Engine | None = engine
        self._sizes = [newtons if axis.kind == FORCE else newton_metres for axis in axes]
        self._wrenches = np.array([axis.wrench for axis in axes])
        self._system, self._h = _at_rest(state, memory), state.scenario.controller.period

    def sine(self, frequency: float) -> Measured:
        """Measurement with a sine near this frequency (Hz), over whole cycles after `LEAD` s. Raises ScenarioError,
        also where a run stops."""
        self._require("--measure", frequency)
        counted = round(CYCLES / (frequency * self._h))
        frequency = CYCLES / (counted * self._h)
        lead = max(LEAD, 2.0 / frequency)
        first = round((SETTLES + lead) / self._h)
        push = TimedPush(np.zeros(3), self._begins, math.inf, frequency=frequency)
        return self._measured(push, np.array([frequency]), slice(first, first + counted))[0]

    def chirp(self, chirp: Chirp) -> list[Measured]:
        """Measurement with a chirp, from before its beginning until the tool is at rest again. Raises ScenarioError,
        also where a run stops."""
        for frequency in (chirp.low, chirp.high):
            self._require("--chirp", frequency)
        if not chirp.low < chirp.high:
            raise ScenarioError(f"--chirp {chirp.low:g} {chirp.high:g}: Hz; allowed: the lower one first")
        push = TimedPush(np.zeros(3), self._begins, chirp.seconds, frequency=chirp.low, sweep_to=chirp.high)
        frequencies = np.geomspace(chirp.low, chirp.high, chirp.points)
        return self._measured(push, frequencies, slice(round((SETTLES + chirp.seconds + RESTS) / self._h)))

    def _require(self, option: str, frequency: float) -> None:
        if not 1.0 / LONGEST <= frequency <= 1.0 / (SHORTEST * self._h):
            raise ScenarioError(
                f"{option} {frequency:g}: Hz; allowed: {1.0 / LONGEST:.3g} to {1.0 / (SHORTEST * self._h):g} Hz with "
                "this period"
            )

    @property
    def _begins(self) -> float:
        return self._state.t + SETTLES

    def _measured(self, push: TimedPush, frequencies: np.ndarray, counted: slice) -> list[Measured]:
        """Admittance at each frequency (N,) Hz, of the rows that count."""
        still, _ = self._run(push, counted)
        columns = []
        for axis, size in zip(self._axes, self._sizes, strict=True):
            force, moment = np.split(size * axis.wrench, 2)
            speeds, wrench = self._run(push._replace(force=force, moment=moment), counted)
            wave = np.exp(-2j * np.pi * self._h * np.outer(frequencies, np.arange(len(wrench))))
            columns.append((wave @ (speeds - still)) / (wave @ (wrench @ axis.wrench))[:, None])
        return [
            Measured(float(f), admittance) for f, admittance in zip(frequencies, np.stack(columns, axis=2), strict=True)
        ]

    def _run(self, push: TimedPush, counted: slice) -> tuple[np.ndarray, np.ndarray]:
        """Mean speeds along the axes (N, p) in the periods that count, and the pushes (N, 6) N and N m."""
        loop = ClosedLoop.from_system_and_state(replace(self._system, push=push), self._state, counted.stop + 1)
        play(loop, counted.stop + 1, self._engine)
        if loop.stopped:
            force, moment = (np.linalg.norm(part) for part in (push.force, push.moment))
            size = f"{force:.3g} N" if force else f"{moment:.3g} N·m"
            raise ScenarioError(f"the push of {size}: the run stops: {loop.stopped}")
        rows = loop.recording.signals(("tool", "q", "F_push", "moment_push"))
        ways = [np.diff(rows["tool"], axis=0), _turns(self._system, rows["q"])]
        pushes = np.hstack([rows["F_push"], rows["moment_push"]])[:-1]
        return (np.hstack(ways) @ self._wrenches.T / self._h)[counted], pushes[counted]


def _turns(system: System, q: np.ndarray) -> np.ndarray:
    """Rotation vectors (N - 1, 3) rad in the world, by which the tool turns from each posture to the next. q: (N, n)
    rad."""
    model, joint = system.robot.model, system.robot.tool_joint
    data, turned = model.createData(), []
    for each in q:
        pin.forwardKinematics(model, data, each)
        turned.append(data.oMi[joint].rotation.copy())
    return np.array([pin.log3(after @ before.T) for before, after in pairwise(turned)])


def _at_rest(state: State, memory: Memory | None) -> System:
    """System of the state's scenario with the target model in force; its reference stays where it is now."""
    system, t = assemble(state.scenario, memory=memory).with_shift(state.shift), state.t
    if system.blend is not None and blending(system.blend, t, state.scenario.controller.period):
        system = replace(system, controller=system.controller.following(system.blend.at(t)))
    now, forces = system.reference(t), np.zeros(3)
    forces[: system.m] = now.F_cd[: system.m]
    desired = system.plan
    plan = desired.at_rest(now.r_d, forces)._replace(compliance=desired.compliance, followed=desired.followed)
    return replace(system, plan=plan, blend=None)


class _Point(msgspec.Struct, frozen=True):
    """A `Measured` in a file: the admittance row by row, each entry as its real and its imaginary part."""

    frequency: float
    admittance: list[list[tuple[float, float]]]


def encoded(state: State, axes: Sequence[PushAxis], chirp: Chirp, engine: Engine = "pinocchio") -> bytes:
    """Measurement with a chirp, for another process; see `decoded`. Raises ScenarioError.
    engine: computes the runs; without its kernels in the cache the compiled one takes minutes."""
    from app.storage.constants_store import kept_memory

    found = PushExperiment(state, axes, memory=kept_memory(), engine=engine).chirp(chirp)
    points = [
        _Point(each.frequency, [[(entry.real, entry.imag) for entry in row] for row in each.admittance.tolist()])
        for each in found
    ]
    return msgspec.json.encode(points)


def decoded(content: bytes) -> list[Measured]:
    """Measurement that `encoded` made."""
    points = msgspec.json.decode(content, type=list[_Point])
    return [
        Measured(p.frequency, np.array([[complex(*entry) for entry in row] for row in p.admittance])) for p in points
    ]


def chirp_for(state: State) -> Chirp:
    """Chirp for the page: as far as this control period allows."""
    return Chirp(high=min(Chirp().high, 0.2 / state.scenario.controller.period))


def not_linear(state: State) -> tuple[str, ...]:
    """Properties of a run from this state that a linear prediction leaves out, in words; empty where none is known."""
    scenario = state.scenario
    load, pressed = state.arm.views.load, max(sum(each.pressed for each in scenario.surfaces), 1)
    apart = state.t > 0.0 or np.abs(load.phi[:pressed]).max() > NEAR  # at the start a surface may be met, yet unpressed
    away, presses = apart and not state.evaluation.views.touching, mode_of(scenario).pressed > 0
    # a mode that presses nothing may be where nothing is met, and the prediction has every contact there is
    within_reach = any(each.contact.nature.touches and each.contact.unilateral for each in scenario.surfaces)
    clear = apart and within_reach and not load.multiplier.any()
    rough = any(each.contact.nature.touches and each.contact.friction_coulomb > 0.0 for each in scenario.surfaces)
    controller, errors = scenario.controller, scenario.declared
    grows = law_of(scenario).robust and controller.gain == "theorem" and errors != Declared()
    known = {
        "the tool does not touch every surface that it should press": presses and away,
        "that the tool touches nothing there (the lines are those of the contact)": not presses and clear,
        "dry friction on a surface": rough,
        "a surface that changes its shape or turns": any(each.form.changing for each in scenario.surfaces),
        "dry friction in the joints": scenario.truth.coulomb > 0.0,
        "a limit of the torques": bool(np.any(np.asarray(scenario.truth.torque_limit))),
        "the gain d by (17), which grows with the push": grows,
    }
    return tuple(what for what, so in known.items() if so)


def deviation_sentence(points: Sequence[Measured], response: PushResponse, beside: Sequence[str]) -> str:
    """Sentence on how far the measured points are from what the sampled loop predicts, and where that is far, on what
    the prediction leaves out. beside: of `not_linear`."""
    frequency = np.array([point.frequency for point in points])
    found, predicted = np.array([point.admittance for point in points]), response.admittance(frequency)
    apart, predicted = (np.abs(response.in_metres(each)).max(axis=(1, 2)) for each in (found - predicted, predicted))
    yields = np.maximum(apart, predicted) / (2 * np.pi * frequency)
    if yields.max() <= RIGID:
        return "measured: the tool does not yield, as predicted"
    apart = apart / np.maximum(predicted, 2 * np.pi * frequency * RIGID)
    worst = int(apart.argmax())
    far = apart[worst] > FAR
    frequencies = "1 frequency" if len(points) == 1 else f"{len(points)} frequencies"
    return (
        f"measured: within {100 * apart[worst]:.2g} % of the sampled loop's largest entry at {frequencies}, "
        f"farthest at {points[worst].frequency:.3g} Hz"
        + (f"; the lines are those of a linear loop, which leaves out: {', '.join(beside) or 'more'}" if far else "")
    )
