"""System of a scenario: its objects, which `app.simulation.assembly` checks and puts together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from app.scenario.declared_bounds import outside
from app.scenario.schema import Scenario
from app.scenario.units import Units, kinds_of
from app.simulation.builders.error_model import ErrorModel
from app.simulation.omega.domain import Constants
from app.simulation.omega.reference_postures import DesiredPosture, posture_at
from app.simulation.omega.search_memory import Memory
from app.simulation.omega.stations import Stations
from app.simulation.period.observation import Observed, Observer
from app.simulation.period.planned_reference import Planned, ReferencePlan
from controllers.blend import ModelBlend
from controllers.control_law import Reference
from controllers.controller import Controller
from controllers.modes import Mode
from controllers.nominal_model import NominalModel
from controllers.task_space import TaskLayout
from environments import robots
from environments.plant import Plant
from environments.push import TimedPush
from environments.sensors import ForceSensor
from environments.shift import SmoothShift
from environments.step_resolution import Mobility
from environments.surfaces.corner import Corner
from environments.surfaces.table import Surface

if TYPE_CHECKING:
    from app.simulation.sampled_loop.sampled_stability import SampledLoop


@dataclass(frozen=True)
class Coordinate:
    """One task coordinate: its name and the unit that the screen shows.
    metres_per_radian: the characteristic length where the coordinate is an angle times that, otherwise None."""

    name: str
    unit: str
    metres_per_radian: float | None = None

    @property
    def is_angle(self) -> bool:
        return self.unit == "rad" or self.metres_per_radian is not None

    @property
    def per_radian(self) -> float:
        """Change of an angle's coordinate per radian, in the coordinate's unit."""
        return self.metres_per_radian or 1.0


@dataclass(frozen=True)
class System:
    """System: the objects of a scenario.
    surfaces: all of the world, whether or not the tool touches them.
    charted: gives the task coordinates: the surfaces, or Cartesian axes.
    stations: at which the sampled loops are judged.
    mobility: the true arm's largest over Omega.
    controller: with the target model in force, from which `blend`, if there is one, leads to another.
    q_0: (n,) rad (m for prismatic joints), posture at the start.
    z_0: (n,) m/s, z of (9) at the start, unless `controller.on_change` is "remove" (Remark 2).
    memory: of the results of searches.
    sampled_loops: at the stations, by number, as far as they have been judged; shared by systems in which they are the
    same."""

    scenario: Scenario
    robot: robots.Robot
    mode: Mode
    layout: TaskLayout
    coordinates: tuple[Coordinate, ...]
    surfaces: tuple[Surface, ...]
    charted: Surface | Corner
    nominal: NominalModel
    plant: Plant
    constants: Constants
    stations: Stations
    mobility: Mobility
    controller: Controller
    blend: ModelBlend | None
    sensor: ForceSensor
    push: TimedPush
    plan: ReferencePlan
    q_0: np.ndarray
    z_0: np.ndarray
    memory: Memory
    sampled_loops: dict[int, SampledLoop]

    @property
    def m(self) -> int:
        """Number m of force-controlled directions."""
        return self.mode.force_directions

    @property
    def pressed(self) -> int:
        """Number of surfaces whose normal force is controlled."""
        return self.mode.pressed

    @property
    def surface(self) -> Surface:
        """First surface."""
        return self.surfaces[0]

    @cached_property
    def contact_sensor(self) -> ForceSensor:
        """Force sensor as a contact is read by it: a contact in a point exerts no moment that could be late."""
        return self.sensor if self.plant.face.flat else self.sensor.of_forces()

    @cached_property
    def planned(self) -> Planned:
        """Reference of the run, as a function of time."""
        return Planned(self.plan)

    @cached_property
    def observer(self) -> Observer:
        """Observer with the controller's model of the arm."""
        return Observer(self.nominal, self.charted.shapes, self.layout, ErrorModel.of(self.scenario, self.q_0))

    @cached_property
    def outsiders(self) -> tuple[str, ...]:
        """Inequalities between truth and declaration that the true arm violates, see `declared_bounds.outside`."""
        return outside(self.scenario, self.units)

    @cached_property
    def units(self) -> Units:
        """Units in which r, s and the forces, of the task space and of all joints, are shown."""
        return Units(self.scenario.task_space.kind, kinds_of(self.robot.slides))

    def observe(self, q: np.ndarray, q_dot: np.ndarray, t: float) -> Observed:
        """Observation of a state by the controller."""
        return self.observer.at(q, q_dot, t)

    def reference(self, t: float) -> Reference:
        """r_d and F_cd with their derivatives at time t (s)."""
        return self.planned.at(t)

    def posture_at(self, q: np.ndarray, t: float) -> DesiredPosture:
        """Posture on the reference at t (s), by Newton's method from q (n,) rad."""
        return posture_at(self.observer.record_at, q, self.reference(t), t)

    def after(self, previous: System, t: float) -> System:
        """The system with a shift that continues from that of `previous` at time t (s)."""
        old, new = previous.plan.shift, self.plan.shift
        if (old.end != new.end).any() or old.duration != new.duration:
            old = old.turned(t, new.end, new.duration)
        return self.with_shift(old)

    def anew(self) -> System:
        """The system at t = 0: its shift starts from rest, and a blend is still to come."""
        shift = self.plan.shift
        begun = self.with_shift(SmoothShift.fresh(shift.end, shift.duration))
        return begun if self.blend is None else begun.with_controller(self.controller.following(self.blend.start))

    def with_controller(self, controller: Controller) -> System:
        """The system with this controller, for another target model in force."""
        return replace(self, controller=controller, sampled_loops={})

    def with_shift(self, shift: SmoothShift) -> System:
        """The system with this shift in place of the scenario's, which begins at t = 0."""
        return replace(self, plan=self.plan._replace(shift=shift))

    def tool_at(self, r_d: np.ndarray, t: float) -> np.ndarray:
        """Desired tool point (3,) m, that of r_d (n,); a planar arm stays in its plane."""
        g = np.zeros(3)
        g[: self.layout.positions] = r_d[list(self.layout.position_indices)]
        return self.charted.point(g, t)
