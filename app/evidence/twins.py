"""Twins of a run: a Scenario for the product and a `PaperLoop`, both from the same numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

import numpy as np
import pinocchio as pin

from app.evidence.independent_simulator import Gains, PaperLoop, Wish, World, integrate
from app.evidence.independent_surfaces import Face, Surface, Tilt
from app.scenario.data import edited, from_plain
from app.scenario.schema import Scenario
from app.session.headless_run import simulate
from app.simulation.assembly import assemble
from app.simulation.builders.environment_builder import face_axes
from app.simulation.closed_loop import ClosedLoop
from app.simulation.system import System
from environments.integrators import IntegratorName
from environments.plant import Plant

TOWARDS = np.array([0.28, 0.0, 0.96])  # direction out of the first surface, in the plane of the planar arms
LAYER, D = 0.1, 6.0
WAY, TURN = 0.03, 0.1  # m and rad, of the desired motion along the surface and of the tool's first angle
DEPTH = 0.001  # m, of the tool in an elastic surface at the start
# directions out of a second and a third surface for an arm in space, and out of a second one for a planar arm
FURTHER = ((0.3, -0.9, 0.2), (-0.7, -0.2, 0.4))
FURTHER_PLANAR = ((-0.9, 0.0, 0.3),)
STIFFNESS, BELIEVED, DAMPING = (8000.0, 6000.0, 7000.0), (9000.0, 7000.0, 6000.0), (40.0, 30.0, 20.0)
FORCES, SWINGS = (20.0, 15.0, 10.0), (5.0, 3.0, 2.0)  # N
# between the surfaces 1 and 2, 1 and 3, 2 and 3
COUPLING = {
    "K_e": (2000.0, -1500.0, 1000.0), "K_e_hat": (2500.0, -900.0, 1400.0),
    "B_e": (8.0, -5.0, 6.0), "M_e": (0.8, -0.5, 0.3),
}  # fmt: skip
K_T, K_T_HAT, MOMENTS = 15.0, 12.0, (0.06, -0.04)  # N m/rad and N m, of a flat face
OFF = np.array([0.1, 0.0, -0.05])  # difference of the face's normal from the plane's at the start
TILTING = Tilt(np.array([0.0, 0.8, 0.6]), 0.05, 2 * np.pi * 1.5)
PUSH = np.array([3.0, -2.0, 4.0, 0.3, -0.5, 0.4])


@cache
def arm(robot: str) -> System:
    """System of an arm in Cartesian coordinates, without surfaces."""
    return assemble(from_plain({"robot": {"name": robot}}))


def random_spd(random: np.random.Generator, n: int, low: float, high: float) -> np.ndarray:
    """A full symmetric matrix (n, n) with eigenvalues in [low, high]."""
    Q, _ = np.linalg.qr(random.standard_normal((n, n)))
    return Q @ np.diag(random.uniform(low, high, n)) @ Q.T


@dataclass(frozen=True)
class Twin:
    """Twin of a run: an arm of the catalogue on one to three surfaces.
    mode: "constrained" on rigid surfaces, the others on elastic ones.
    radius: of the first surface, m: a sphere, or 0 for a plane. The others are oblique planes.
    M_e: mass of the surfaces, kg.
    moving: whether the surfaces move.
    unknown: whether the links are 15 % heavier than believed and the joints have friction.
    ideal: see `Scenario.sensor`.
    surfaces: their number.
    pushed: whether a constant wrench acts on the tool.
    flat: whether the tool touches with a flat face, and the plane tilts.
    coupled: whether the surfaces belong to one elastic body.
    followed: number of the surfaces whose distance is followed, the last ones; the tool touches them, too."""

    robot: str
    mode: Literal["hybrid", "hybrid-impedance", "constrained"]
    radius: float = 0.0
    M_e: float = 0.0
    moving: bool = True
    unknown: bool = True
    integrator: IntegratorName = "semi-implicit-euler"  # which evaluates the acceleration at the state itself
    ideal: bool = False
    surfaces: int = 1
    pushed: bool = False
    flat: bool = False
    coupled: bool = False
    followed: int = 0

    @property
    def n(self) -> int:
        return arm(self.robot).robot.n

    @property
    def m(self) -> int:
        """Number of controlled forces and moments."""
        return 3 if self.flat else self.surfaces - self.followed

    @property
    def tilts(self) -> int:
        """Number of coordinates that are tilts of a flat tool."""
        return 2 if self.flat else 0

    @property
    def rigid(self) -> bool:
        return self.mode == "constrained"

    @property
    def moves(self) -> bool:
        """Whether a position follows a path: more of them are coordinates than there are controlled forces."""
        return arm(self.robot).layout.positions > self.surfaces - self.followed

    @property
    def turns(self) -> bool:
        """Whether the tool turns: an angle is among the coordinates."""
        return arm(self.robot).layout.angles > 0

    def all_surfaces(self) -> tuple[Surface, ...]:
        """The first surface and the planes beside it."""
        p = arm(self.robot).nominal.evaluate(arm(self.robot).q_0, np.zeros(self.n)).p
        depth, amplitude = (0.0 if self.rigid else DEPTH), np.array([0.6, 0.0, 0.8]) * (0.004 if self.moving else 0.0)
        inside, omega = p + depth * TOWARDS, 2 * np.pi * 2.0
        first = Surface(inside, -TOWARDS, 0.0, amplitude, omega, TILTING if self.flat else None)
        if self.radius > 0.0:
            first = Surface(inside - self.radius * TOWARDS, TOWARDS, self.radius, amplitude, omega)
        towards = FURTHER_PLANAR if arm(self.robot).robot.geometry == "planar" else FURTHER
        units = [np.array(each) / np.linalg.norm(each) for each in towards[: self.surfaces - 1]]
        return first, *(Surface(p + depth * each, -each, 0.0, 0.5 * amplitude, 1.5 * omega) for each in units)

    def gains(self) -> Gains:
        """Gains of the law, full matrices where the mode admits them."""
        random, n = np.random.default_rng(4), self.n
        M_m, B_m, K_m, K_f = (np.zeros((n, n)) for _ in range(4))
        m = self.m
        M_m[0, 0], B_m[0, 0], K_m[0, 0], K_f[0, 0] = (12.0, 200.0, 0.0 if self.rigid else 300.0, 0.8)
        for matrix, low, high in ((M_m, 6.0, 14.0), (B_m, 150.0, 300.0), (K_m, 1000.0, 4000.0)):
            matrix[m:, m:] = random_spd(random, n - m, low, high)
        if self.mode == "hybrid-impedance":
            K_f[m:, m:] = 0.8 * np.eye(n - m) if self.followed else random_spd(random, n - m, 0.5, 1.5)
        if m > 1:
            for matrix, low, high in ((M_m, 8.0, 14.0), (B_m, 150.0, 250.0), (K_f, 0.7, 1.0)):
                matrix[:m, :m] = random_spd(random, m, low, high)
            if not self.rigid:
                K_m[:m, :m] = random_spd(random, m, 200.0, 400.0)
        F_1, F_2, A = (np.diag(random.uniform(*edge, n)) for edge in ((8.0, 14.0), (0.7, 1.5), (-2.0, -0.2)))
        return Gains(M_m, B_m, K_m, K_f, A, F_1, F_2, random_spd(random, n, 20.0, 40.0), D, LAYER)

    def wish(self) -> Wish:
        displacement = np.zeros(self.n)
        if self.moves:
            displacement[self.m] = self.way
        if self.turns:
            system = arm(self.robot)
            displacement[system.layout.positions + self.tilts] = system.layout.l * TURN
        k, p, l = self.surfaces, self.surfaces - self.followed, arm(self.robot).layout.l
        moments = np.array(MOMENTS) / l if self.flat else np.zeros(0)
        stiffness = np.concatenate([BELIEVED[:k], np.full(len(moments), K_T_HAT / l**2)])
        believed, m = self._with_coupling(np.diag(stiffness), "K_e_hat"), self.m
        compliance = np.zeros((m, m)) if self.rigid else np.linalg.inv(believed[:m, :m])
        forces, swings = np.concatenate([FORCES[:p], moments]), np.concatenate([SWINGS[:p], 0.0 * moments])
        return Wish(displacement, 2 * np.pi, forces, swings, 2 * np.pi * 3.0, compliance, believed[:m, m:])

    @property
    def way(self) -> float:
        """Length (m) of the path of the first free position, which is a depth where a surface is followed."""
        return DEPTH if self.followed else WAY

    def _with_coupling(self, diagonal: np.ndarray, name: str) -> np.ndarray:
        """Matrix (m, m) with the entries off its diagonal that couple the surfaces of one body. name: in COUPLING."""
        matrix = diagonal.copy()
        for (i, j), entry in zip(((0, 1), (0, 2), (1, 2)), COUPLING[name], strict=True):
            if self.coupled and j < self.surfaces:
                matrix[i, j] += entry
                matrix[j, i] += entry
        return matrix

    def _met(self, number: int, surface: Surface) -> tuple[dict[str, object], dict[str, object], dict[str, object]]:
        """Sections surface, contact and force of a scenario, for one surface. number: of the surface, from 0."""
        motion = {
            "direction": [0.6, 0.0, 0.8],
            "amplitude": float(np.linalg.norm(surface.amplitude)),
            "frequency": surface.omega / (2 * np.pi),
        }
        where: dict[str, object] = {"origin": surface.origin.tolist(), "motion": motion}
        if (tilt := surface.tilt) is not None:
            frequency = tilt.omega / (2 * np.pi)
            where["tilt"] = {"axis": tilt.axis.tolist(), "amplitude": tilt.amplitude, "frequency": frequency}
        normal = surface.normal.tolist()
        kind = "rigid" if self.rigid else "mass-damper-spring" if self.M_e else "elastic"
        springs = {"B_e": DAMPING[number], "K_e": STIFFNESS[number]}
        return (
            {"kind": "sphere", "radius": surface.radius, "reference": normal, **where} if surface.radius
            else {"kind": "plane", "normal": normal, **where},
            {"kind": kind, "M_e": self.M_e, **springs, "unilateral": False},
            {"kind": "sinusoid", "value": FORCES[number], "amplitude": SWINGS[number], "frequency": 3.0},
        )  # fmt: skip

    def scenario(self, period: float) -> Scenario:
        gains, met = self.gains(), [self._met(i, each) for i, each in enumerate(self.all_surfaces())]
        push = {"push": PUSH[:3].tolist(), "push_moment": PUSH[3:].tolist(), "push_start": 0.0, "push_duration": 3600.0}
        further = {
            name: {
                "surface": surface, "contact": contact, "force": force, "K_e_hat": K_e_hat,
                "control": "force" if number < self.surfaces - self.followed else "path",
            }
            for number, name, (surface, contact, force), K_e_hat in zip(
                (1, 2), ("second", "third"), met[1:], BELIEVED[1:], strict=False
            )
        }  # fmt: skip
        R = arm(self.robot).nominal.evaluate(arm(self.robot).q_0, np.zeros(self.n)).R
        return from_plain({
            **further,
            "face": {
                "flat": self.flat, "normal": (R.T @ (OFF - TOWARDS)).tolist(), "K_t": K_T, "K_t_hat": K_T_HAT,
                "moment": list(MOMENTS),
            },
            "coupling": {name: list(entries) for name, entries in COUPLING.items()} if self.coupled else {},
            "mode": self.mode,
            "robot": {"name": self.robot},
            "truth": ({"link_scaling": 1.15, "viscous": 0.4} if self.unknown else {}) | (push if self.pushed else {}),
            "target_model": {name: getattr(gains, name).tolist() for name in ("M_m", "B_m", "K_m", "K_f")},
            "controller": {
                **{name: getattr(gains, name).tolist() for name in ("A", "F_1", "F_2", "K_s")},
                "gain": "constant", "d": D, "layer": LAYER, "period": period, "K_e_hat": BELIEVED[0],
            },
            "surface": met[0][0],
            "contact": met[0][1],
            "force": met[0][2],
            "sensor": {"ideal": self.ideal},
            "motion": {"kind": "line", "displacement": [self.way], "period": 1.0, "ramp": 0.0}
            if self.moves else {"kind": "hold"},
            "rotation": {"kind": "line", "displacement": [TURN], "period": 1.0, "ramp": 0.0}
            if self.turns else {"kind": "hold"},
            "simulation": {"duration": 1.0, "integrator": self.integrator},
        })  # fmt: skip

    def paper(self) -> PaperLoop:
        scenario = self.scenario(0.001)
        truth, k, l = scenario.truth, self.surfaces, scenario.task_space.characteristic_length
        turning = np.full(self.tilts, K_T / l**2)
        M_e, K_e = self.M_e * np.eye(k + self.tilts), np.diag(np.concatenate([STIFFNESS[:k], turning]))
        B_e = np.diag(np.concatenate([DAMPING[:k], turning * DAMPING[0] / STIFFNESS[0]]))
        if self.M_e:
            M_e = self._with_coupling(M_e, "M_e")
        world = World(
            self.all_surfaces(), self.rigid, M_e, self._with_coupling(B_e, "B_e"),
            self._with_coupling(K_e, "K_e"), float(np.max(truth.link_scaling)), truth.viscous,
            all=self.mode == "hybrid-impedance", push=PUSH if self.pushed else np.zeros(6),
            face=self.face(scenario) if self.flat else None,
        )  # fmt: skip
        system = assemble(scenario)
        start = system.plant.start(system.q_0, np.zeros(self.n), 0.0).views
        return PaperLoop(
            system.robot,
            start.q,
            start.q_dot,
            self.gains(),
            self.wish(),
            world,
            l,
        )

    def face(self, scenario: Scenario) -> Face:
        """Face of a flat tool; its turn counts from the direction of its first axis at the start, along the plane at
        rest."""
        axes, system = face_axes(scenario), assemble(scenario)
        first = system.nominal.evaluate(system.q_0, np.zeros(self.n)).R @ axes[0]
        normal = -TOWARDS
        along = first - (first @ normal) * normal
        along = along / np.linalg.norm(along)
        return Face(axes, np.stack([along, np.cross(normal, along)]))


def loop_errors(twin: Twin, periods: Sequence[float], duration: float) -> np.ndarray:
    """Largest differences (N,) of q (rad) between the sampled loop and the paper's, for control periods (N,) s, of
    which each is the first one over a whole number."""
    times = np.arange(0.0, duration, periods[0])
    exact = twin.paper().solve(times)[:, 0]
    errors = []
    for period in periods:
        loop, every = ClosedLoop.from_scenario(twin.scenario(period)), round(periods[0] / period)
        for _ in range(every * (len(times) - 1) + 1):
            loop.step()
            assert loop.stopped is None
        errors.append(np.abs(loop.recording.signals(("q",))["q"][::every] - exact).max())
    return np.array(errors)


def plant_errors(twin: Twin, substeps: Sequence[int], duration: float) -> np.ndarray:
    """Largest errors (N,) of (q, q_dot) (rad, rad/s) after `duration` s under a constant torque. substeps: numbers (N,)
    of the plant's steps in this time."""
    scenario = twin.scenario(0.001)
    system, n = assemble(scenario), twin.n
    random = np.random.default_rng(5)
    paper, start = (
        replace(twin, pushed=False).paper(),
        system.plant.start(system.q_0, random.uniform(-0.5, 0.5, n), 0.0),
    )
    tau = pin.computeGeneralizedGravity(paper.true, paper.true.createData(), system.q_0) + random.uniform(-3, 3, n)
    q, q_dot = start.views.q, start.views.q_dot
    y_0 = np.concatenate([q, q_dot])
    exact = integrate(paper.slope_under(tau), y_0, np.array([0.0, duration]), rtol=1e-12)[-1]
    errors = []
    for number in substeps:
        plant = Plant(
            system.robot, system.plant.truth, system.surfaces, scenario.contact.nature, system.plant.contacts,
            twin.integrator, number, system.plant.face, system.plant.environment,
        )  # fmt: skip
        state = plant.start(q, q_dot, 0.0)
        plant.advance(state, tau, 0.0, duration)
        errors.append(np.abs(np.concatenate([state.views.q, state.views.q_dot]) - exact).max())
    return np.array(errors)


def bands(scenario: Scenario, periods: Sequence[float], since: float) -> np.ndarray:
    """Largest ||s|| (N,) m/s from the time `since` (s) on, for control periods (N,) s."""
    found = []
    for period in periods:
        loop, metrics = simulate(edited(scenario, "controller.period", period))
        assert metrics.stopped is None
        found.append(loop.recording.signals(("s_norm",), t_from=since)["s_norm"].max())
    return np.array(found)
