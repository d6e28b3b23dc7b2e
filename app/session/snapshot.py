"""Snapshot of the loop at one moment, for the screen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from app.scenario.schema import Scenario
from app.session.own_push import OwnPush
from app.session.pacing import Pace
from app.session.timeline import Pinned
from app.session.ways_out import WayOut
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.promise.standing import standing_of
from app.simulation.promise.verdict import Standing
from app.simulation.recording import Recording
from app.simulation.sampled_loop.sampled_stability import RespondingLoop
from app.simulation.state import State
from app.simulation.system import Coordinate, System
from app.simulation.view import View
from environments.robots import Robot
from environments.surfaces.table import Surface

PREPARING = "preparing another arm, contact or path; the first one of its kind is compiled, which may take a minute"


@dataclass(frozen=True)
class Snapshot(View):
    """View of the loop at one moment, with its run, for the screen. Its arrays are never changed afterwards. The plant,
    law and nominal model of a system belong to the loop's thread; the screen reads only what never changes.

    revision: number of accepted changes of the scenario.
    run: number of beginnings at t = 0 and forks.
    refusal_number: number of refused commands.
    executed: number of commands that were carried out or refused.
    way_out: out of the last refusal, None where there is none.
    own_push: the scenario's own push, with which its next run begins.
    t: the instant looked at, between `first` and `end`, s.
    performing: whether a run up to a given instant is going on, or was paused on the way there, see `Perform`.
    scenario, system: those at t.
    latest: the system at `end`.
    recording: of the whole run, up to its end.
    stop: why the run has stopped at `end`, "" where it has not.
    blending: share of a blend of the target model that is done, 0 to 1, None while there is none.
    sampled: the target model's poles in the sampled loop.
    forks: instants at which the run was forked, s.
    surfaces: those that the tool may meet.
    """

    scenario: Scenario
    revision: int
    run: int
    t: float
    first: float
    end: float
    performing: bool
    phase: Literal["running", "paused", "stopped"]
    reason: str
    stop: str
    pace: Pace | None  # None unless it has been running for a moment
    speed: float
    refusal: str | None
    refusal_number: int
    executed: int
    way_out: WayOut | None
    own_push: OwnPush
    notice: str
    system: System
    robot: Robot
    coordinates: tuple[Coordinate, ...]
    blending: float | None
    surfaces: tuple[Surface, ...]
    sampled: RespondingLoop
    latest: System
    recording: Recording
    pinned: tuple[Pinned, ...]
    forks: tuple[float, ...]
    state: State

    # what a picture of the scene does not need is found when it is first read

    @cached_property
    def fixed(self) -> dict[str, np.ndarray]:
        """Entries of the matrices of (8) that the mode fixes."""
        return self.system.mode.fixed(self.system.layout.n)

    @cached_property
    def matrices(self) -> dict[str, np.ndarray]:
        """Matrices of (8) in force, each (n, n)."""
        return {name: getattr(self.system.controller.model, name) for name in ("M_m", "B_m", "K_m", "K_f")}

    @cached_property
    def standing(self) -> Standing:
        """Premises and verdict."""
        return standing_of(self.system, self.state)

    @property
    def preparing(self) -> bool:
        """Whether the loop prepares another arm, contact or path, and stands still meanwhile."""
        return self.notice == PREPARING

    @property
    def looking_back(self) -> bool:
        """Whether t is before the run's end."""
        return self.end - self.t > 0.5 * self.scenario.controller.period

    @property
    def at_end(self) -> Snapshot:
        """The snapshot with scenario, system and coordinates of the run's end, for what is told of the whole run."""
        system = self.latest
        return replace(self, t=self.end, scenario=system.scenario, system=system, coordinates=system.coordinates)

    @property
    def realtime_factor(self) -> float:
        """Simulated seconds per second of wall time, as achieved; 0 where that is not known."""
        return self.pace.achieved * self.scenario.controller.period if self.pace else 0.0


def with_conditions_at(snapshot: Snapshot, t: float) -> Snapshot:
    """The snapshot with the scenario and the system that were in force at t (s) of its run, which may have been changed
    since, and with the target model to which a blend had led. Raises ScenarioError where that arm cannot be built any
    more."""
    past = [epoch for epoch in tuple(snapshot.recording.epochs) if epoch.t <= t]
    if not past:
        return snapshot
    model, system = past[-1].model_at(t), snapshot.system
    if past[-1].scenario != snapshot.scenario:
        # nothing of the loop's system but what it has searched, since its thread may go on
        system = assemble(past[-1].scenario, memory=system.memory)
    if not model.same(system.controller.model):
        system = replace(system, controller=system.controller.following(model))
    if system is snapshot.system:
        return snapshot
    return replace(snapshot, scenario=past[-1].scenario, system=system, coordinates=system.coordinates)


def as_recorded(snapshot: Snapshot, t_from: float, t_to: float) -> Snapshot:
    """The snapshot with what was in force at the last recorded row of this stretch of time, s, see
    `with_conditions_at`; itself where there is no row."""
    pieces = snapshot.recording.pieces(t_from, t_to)
    return with_conditions_at(snapshot, float(pieces[-1][-1, 0])) if pieces else snapshot


def snapshot_of(loop: ClosedLoop) -> Snapshot:
    """Snapshot of a loop that no thread runs: it is paused, unless it has stopped."""
    system, scenario = loop.system, loop.system.scenario
    return Snapshot(
        **vars(loop.view()),
        scenario=scenario,
        revision=0,
        run=0,
        t=loop.t,
        first=loop.t,
        end=loop.t,
        performing=False,
        phase="stopped" if loop.stopped else "paused",
        reason=loop.stopped or "",
        stop=loop.stopped or "",
        pace=None,
        speed=1.0,
        refusal=None,
        refusal_number=0,
        executed=0,
        way_out=None,
        own_push=OwnPush(),
        notice=loop.warning or "",
        robot=system.robot,
        coordinates=system.coordinates,
        blending=system.blend.share(loop.t) if system.blend is not None and loop.blending else None,
        surfaces=system.surfaces if scenario.contact.nature.touches or system.m else (),
        sampled=loop.sampled,
        latest=system,
        recording=loop.recording,
        pinned=(),
        forks=(),
        system=system,
        state=loop.state.copy(),
    )
