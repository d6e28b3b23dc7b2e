"""Microseconds per control period, next to the bare Pinocchio calls that the same period needs.

Rounds of all rows are interleaved, so that a machine whose speed drifts treats them alike; medians are printed, and
ratios are medians of the ratios round by round.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from statistics import median

import numpy as np
import pinocchio as pin
from tqdm import tqdm

from app.closed_loop import ClosedLoop
from app.scenario import load

SCENARIOS = ("ur5-hybrid", "ur5-motion", "ur5-constrained", "panda-hybrid", "planar2r-semicircle", "planar3r-hybrid")
ROUNDS, STEPS = 7, 1000


def bare_calls(loop: ClosedLoop) -> Callable[[], None]:
    """What Pinocchio must do in one period of this loop: Coriolis, mass, gravity and placements for the law; the
    tool's Jacobian and the forward dynamics for the plant."""
    robot = loop.system.robot
    model, data = robot.model, robot.model.createData()
    true, true_data = loop.system.plant.model, loop.system.plant.model.createData()
    q, v = robot.posture, np.zeros(robot.n)
    tau = np.zeros(robot.n)

    def period() -> None:
        pin.computeCoriolisMatrix(model, data, q, v)
        pin.crba(model, data, q)
        pin.computeStaticRegressor(model, data, q)
        pin.computeJointJacobians(true, true_data, q)
        pin.aba(true, true_data, q, v, tau)

    return period


def microseconds(call: Callable[[], None]) -> float:
    """Mean time of one call over a round."""
    started = time.perf_counter()
    for _ in range(STEPS):
        call()
    return (time.perf_counter() - started) / STEPS * 1e6


def main() -> None:
    """Print the table."""
    loops = {name: ClosedLoop(load(name)) for name in SCENARIOS}
    for loop in tqdm(loops.values(), desc="compiling"):
        loop.step()
    steps: dict[str, list[float]] = {name: [] for name in SCENARIOS}
    bare: dict[str, list[float]] = {name: [] for name in SCENARIOS}
    floors = {name: bare_calls(loop) for name, loop in loops.items()}
    for _ in tqdm(range(ROUNDS), desc="rounds"):
        for name, loop in loops.items():
            steps[name].append(microseconds(loop.step))
            bare[name].append(microseconds(floors[name]))
    machine = f"{platform.machine()}, Python {platform.python_version()}, pin {pin.__version__}"
    print(f"\n{machine}, {ROUNDS} rounds of {STEPS}\n")
    print(f"{'scenario':24s}{'step, us':>10s}{'bare pin, us':>14s}{'ratio':>8s}{'x real time':>13s}")
    for name, loop in loops.items():
        if loop.stopped:
            raise RuntimeError(f"{name}: {loop.stopped}")
        ratio = median(a / b for a, b in zip(steps[name], bare[name], strict=True))
        times = loop.system.scenario.controller.period / (median(steps[name]) * 1e-6)
        print(f"{name:24s}{median(steps[name]):10.1f}{median(bare[name]):14.1f}{ratio:8.1f}{times:13.1f}")


if __name__ == "__main__":
    main()
