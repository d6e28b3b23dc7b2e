"""Random arms in and around the declared set, and random situations for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any
from zlib import crc32

import msgspec
import numpy as np

from app.scenario.data import edited, from_plain
from app.scenario.departures import Departure, Random
from app.scenario.schema import Declared, Scenario, TruthSection
from app.session.headless_run import play
from app.simulation.assembly import assemble
from app.simulation.builders.environment_builder import contacts_of, environment_of, truth_of
from app.simulation.closed_loop import ClosedLoop
from app.simulation.system import System
from controllers.nominal_model import NominalModel
from environments import robots
from environments.plant import Plant

KILOGRAM_ARMS = ("planar2r", "planar3r")  # textbook arms of about 1 kg a link
LINKS = {"link_scaling": 0.15, "rotor_scaling": 0.15, "link_centre": 0.001, "link_shape": 0.02}
HEAVY_LOAD = Declared(**LINKS, payload_mass=1.0, payload_offset=0.05, coulomb=0.5, viscous=0.3, disturbance=2.0)
LIGHT_LOAD = Declared(**LINKS, payload_mass=0.2, payload_offset=0.02, coulomb=0.1, viscous=0.05, disturbance=0.3)
PERIOD = 0.001  # s, the control period of the shipped scenarios
BOUNDS = ("tight", "paper")
LAYERS = (0.004, 0.03)  # m/s, around the 0.01 of the shipped scenarios
DURATION, BRIEF = 0.4, 0.12  # s; brief where the loop through the multiplier is solved, which takes long


def random_of(robot: str, mode: str, *numbers: int) -> Random:
    """Random stream, another one for each robot, mode and numbers."""
    return np.random.default_rng([crc32(f"{robot} {mode}".encode()), *numbers])


def situation(robot: str, mode: str, seed: int) -> Scenario:
    """Scenario of a situation: a posture, a path, a surface and a force, such that s starts away from zero.

    For this, the path begins at full speed (or the surface, where the arm has a single direction along it), and the
    pressed surface is not at the place that r_fd assumes.
    """
    random = random_of(robot, mode, seed)
    entry = robots.load(robot)
    posture = entry.posture + random.uniform(-0.1, 0.1, entry.n)
    nominal = NominalModel(entry.model, entry.tool_joint, entry.tool_placement)
    x, y, z = nominal.evaluate(posture, np.zeros(entry.n)).p.tolist()
    rigid, pressed = mode == "constrained", mode in ("hybrid", "hybrid-impedance")
    speed, period, frequency = random.uniform(0.2, 0.4), random.uniform(0.8, 2.0), random.uniform(0.5, 2.0)
    radius = speed * period / (2 * np.pi)
    motion: dict[str, Any] = {"kind": "circle", "radius": radius, "axes": random.permutation(2).tolist()}
    if entry.geometry == "planar" and (pressed or rigid):
        motion = {"kind": "line", "displacement": [2 * radius]}
    return from_plain({
        "mode": mode,
        "robot": {"name": robot, "posture": posture.tolist()},
        "declared": msgspec.to_builtins(LIGHT_LOAD if robot in KILOGRAM_ARMS else HEAVY_LOAD),
        "controller": {"on_change": "watch", "period": PERIOD},
        "contact": {
            "kind": {"motion": "free", "constrained": "rigid"}.get(mode, "elastic"),
            "K_e": float(10 ** random.uniform(3.0, 4.0)),
            "unilateral": not rigid,
            "friction_coulomb": 0.0 if rigid else random.uniform(0.0, 0.2),
            "friction_viscous": random.uniform(0.0, 30.0),
        },
        "sensor": {"ideal": rigid},  # the theorem assumes F to be known; `arms.lag` tests a multiplier of a period ago
        "surface": {
            "kind": "plane",
            "origin": [x, y, z - (random.uniform(-0.002, 0.015) if pressed else 0.0)],
            "motion": {
                "direction": [1.0, 0.0, 0.0],
                "amplitude": random.uniform(0.15, 0.3) / (2 * np.pi * frequency),
                "frequency": frequency,
            },
        },
        "motion": motion | {"period": period, "ramp": 0.0},
        "force": {"kind": "constant", "value": random.uniform(5.0, 30.0)},
        "simulation": {"duration": BRIEF if rigid else DURATION, "domain_radius": 0.25},
    })  # fmt: skip


def with_gains(scenario: Scenario, random: Random) -> Scenario:
    """The scenario with random K_s, epsilon, F_1, switching function and boundary layer."""
    controller = msgspec.structs.replace(
        scenario.controller,
        K_s=float(10 ** random.uniform(1.3, 2.5)),
        epsilon=float(10 ** random.uniform(0.0, 1.3)),
        F_1=random.uniform(8.0, 20.0),
        switching=str(random.choice(["discontinuous", "saturation"])),
        layer=float(np.exp(random.uniform(*np.log(LAYERS)))),
    )
    return msgspec.structs.replace(scenario, controller=controller)


def built(scenario: Scenario, previous: System | None = None) -> System:
    """System of a scenario. Raises ScenarioError.

    The mobility over Omega, which decides whether the plant's substeps are short enough, is that of the nominal arm: a
    search for each true arm would take ten times as long as its run.
    """
    nominal = assemble(msgspec.structs.replace(scenario, truth=TruthSection()), previous)
    return replace(with_arm_of(scenario, nominal), scenario=scenario)


def with_arm_of(scenario: Scenario, system: System) -> System:
    """The system with the true arm of `scenario`."""
    plant = Plant(
        system.robot,
        truth_of(scenario, system.robot),
        system.surfaces,
        system.plant.nature,
        contacts_of(scenario),
        scenario.simulation.integrator,
        scenario.simulation.substeps,
        environment=environment_of(scenario),
    )
    return replace(system, plant=plant)


def run(system: System) -> ClosedLoop:
    """Run of the scenario's duration, or until it stops."""
    scenario = system.scenario
    steps = max(1, round(scenario.simulation.duration / scenario.controller.period))
    loop = ClosedLoop.from_system(system, steps + 1)
    play(loop, steps)
    return loop


def drawn(robot: str, mode: str, seed: int, number: int) -> Scenario:
    """Scenario of a random plant inside the declared set, with random gains; every second one, counted over plants and
    situations, has the bounds of (7). number: of the plant in its situation."""
    here, random = situation(robot, mode, seed), random_of(robot, mode, seed, number)
    here = edited(here, "controller.bounds", BOUNDS[(seed + number) % 2])
    truth = Departure.inside(random, len(here.robot.posture or ())).truth(here.declared)
    return with_gains(msgspec.structs.replace(here, truth=truth, name=f"{robot}-{mode}-{seed}-{number}"), random)


def later_rows(promised: np.ndarray) -> np.ndarray:
    """Mask (N,) of the rows with a promise but for the first row of each, where bounds follow from ||s|| itself, so
    that no arm can be over them."""
    return promised & np.append(False, promised[:-1])


def largest_ratio(record: Mapping[str, np.ndarray]) -> float:
    """Largest ||s|| of a recording over (20) with its band in its `later_rows`, 0 where there are none."""
    limit = record["s_bound"] + record["s_band"]
    stands = later_rows(np.isfinite(limit))
    return float((record["s_norm"][stands] / limit[stands]).max(initial=0.0))
