"""Benchmark of a step: time of one control period of every scenario, beside the time of its bare Pinocchio calls and
that of MuJoCo."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from statistics import median

import numpy as np
import pinocchio as pin
from tqdm import tqdm

from app.process.markdown import Table
from app.scenario.data import edited, load
from app.scenario.schema import Scenario
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from benchmarks import mujoco_osc
from benchmarks.effort import Effort
from benchmarks.rounds import Call, Whole, interleaved, ratio

SCENARIOS = ("ur5-hybrid", "ur5-motion", "ur5-constrained", "panda-hybrid", "planar2r-semicircle", "planar3r-hybrid")
OURS = "ur5-hybrid"  # the task that MuJoCo gets, too
RK4 = f"{OURS}, rk4"
FLOOR = "bare pin calls of "
COMPILED = ", compiled"
THREADS = (1, 2)  # numbers of threads that compute a run each at the same time
# Factor of the periods of their runs: handing a run to a thread takes as long as a dozen periods, and who ends first
# waits for the other one.
LONGER = 40
TOGETHER = {threads: f"{OURS}{COMPILED}, {threads} thread{'s' if threads > 1 else ''}" for threads in THREADS}
HISTORY = 4096  # rows of the recording, so that its memory is soon reused, and no allocation is measured
WARM = 14_000  # steps before the first round, until no new memory is needed


def scenarios() -> dict[str, Scenario]:
    """Scenarios of the benchmark, by the names of their rows."""
    return {name: load(name) for name in SCENARIOS} | {RK4: edited(load(OURS), "simulation.integrator", "rk4")}


def bare_calls(loop: ClosedLoop) -> Call:
    """Function with all of Pinocchio's calls of one period of a loop. For the law: the Coriolis matrix, which includes
    the mass matrix, and placements. For the plant: mass matrix and bias; with a contact, the tool's Jacobian; on a
    rigid surface also the Jacobian's rate, and mass matrix and Jacobian at the next posture before and after it is
    moved onto the surface."""
    robot = loop.system.robot
    model, data = robot.model, robot.model.createData()
    true, true_data = loop.system.plant.model, loop.system.plant.model.createData()
    q, v = robot.posture, np.zeros(robot.n)

    def law() -> None:
        pin.computeCoriolisMatrix(model, data, q, v)
        pin.computeStaticRegressor(model, data, q)

    def plant() -> None:
        pin.crba(true, true_data, q)
        pin.nonLinearEffects(true, true_data, q, v)

    def free() -> None:
        law()
        plant()

    def elastic() -> None:
        law()
        plant()
        pin.computeJointJacobians(true, true_data, q)

    def rigid() -> None:
        law()
        pin.computeJointJacobiansTimeVariation(true, true_data, q, v)
        plant()
        pin.crba(true, true_data, q, pin.Convention.WORLD)
        pin.computeJointJacobians(true, true_data, q)

    nature = loop.system.plant.nature
    return rigid if nature.rigid else elastic if nature.touches else free


class Together:
    """Runs of one scenario together: compiled, each advanced by a thread of its own at the same time."""

    def __init__(self, scenario: Scenario, threads: int) -> None:
        self._loops = [ClosedLoop.from_scenario(scenario, HISTORY) for _ in range(threads)]
        self._runs = [CompiledRun(loop) for loop in self._loops]
        self._pool = ThreadPoolExecutor(threads)

    def advance(self, periods: int) -> None:
        """Advance every run by a number of control periods."""
        list(self._pool.map(lambda run: run.advance(periods), self._runs))

    def advance_long(self, periods: int) -> None:
        """Advance every run by `LONGER` times a number of control periods."""
        self.advance(LONGER * periods)

    @property
    def stopped(self) -> str | None:
        """Why one of the runs has stopped, None where all of them run."""
        return next((loop.stopped for loop in self._loops if loop.stopped), None)

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown()


def measure(effort: Effort) -> Table:
    """Table of steps. Raises RuntimeError where a run stopped early or did not follow its task."""
    loops, calls = dict[str, ClosedLoop](), dict[str, Call | Whole]()
    for name, scenario in tqdm(scenarios().items(), desc="compiling", leave=False, disable=None):
        stepped, whole = ClosedLoop.from_scenario(scenario, HISTORY), ClosedLoop.from_scenario(scenario, HISTORY)
        run = CompiledRun(whole)
        for _ in range(WARM):
            stepped.step()
        run.advance(WARM)
        loops |= {name: stepped, name + COMPILED: whole}
        calls |= {name: stepped.step, name + COMPILED: Whole(run.advance)}
        if name != RK4:
            calls[FLOOR + name] = bare_calls(stepped)
    contenders = mujoco_osc.contenders(loops[OURS].system)
    together = {TOGETHER[threads]: Together(load(OURS), threads) for threads in THREADS}
    for name, runs in together.items():
        runs.advance(WARM)
        calls[name] = Whole(runs.advance_long)
    times = interleaved(calls | contenders, effort.rounds, effort.steps)
    for threads, name in TOGETHER.items():
        together[name].close()
        times[name] = [us / (threads * LONGER) for us in times[name]]
    for name, loop in (*loops.items(), *together.items()):
        if loop.stopped:
            raise RuntimeError(f"{name}: {loop.stopped}")
    header = (
        "one control period",
        "µs",
        "× real time",
        "bare pin calls, µs",
        "× bare calls",
        f"× {OURS}",
        f"× {OURS}{COMPILED}",
    )
    rows = []
    for name in (*loops, *together, *contenders):
        us, floor = times[name], times.get(FLOOR + name)
        period = loops[name if name in loops else OURS].period
        rows.append(
            (
                name,
                f"{median(us):.1f}",
                f"{period / median(us) * 1e6:.1f}",
                f"{median(floor):.1f}" if floor else "",
                f"{ratio(us, floor):.1f}" if floor else "",
                f"{ratio(us, times[OURS]):.2f}",
                f"{ratio(us, times[OURS + COMPILED]):.2f}",
            )
        )
    return Table(header, rows)
