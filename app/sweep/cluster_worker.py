"""Runs of a sweep in a worker of Dask, on whatever machine it is."""

from __future__ import annotations

import pickle
import threading
from functools import lru_cache

from app.scenario.errors import ScenarioError
from app.sweep.fingerprint import fingerprint, own_urdfs
from app.sweep.plan import Sweep
from app.sweep.run_metrics import RunMetrics, SweepRunner

# A runner is for one thread, and a worker may have several: a second one waits.
_alone = threading.Lock()


def metrics(pickled: bytes, numbers: tuple[int, ...]) -> list[RunMetrics]:
    """Metrics of runs by their numbers. Raises ScenarioError where this machine has another version of the program.

    pickled: the sweep, pickled, because a sweep with parameters of the user's own has no hash.
    """
    with _alone:
        runner = _runner(pickled)
        return [runner.metrics(number) for number in numbers]


@lru_cache(maxsize=2)
def _runner(pickled: bytes) -> SweepRunner:
    try:
        sweep: Sweep = pickle.loads(pickled)  # Dask has unpickled what it came with already
    except Exception as error:  # whatever another version makes of it
        raise ScenarioError(
            f"the program on this worker cannot read the sweep ({type(error).__name__}: {error}); allowed: the same "
            "versions of vsmrc-lab, numba, numpy, pin, scipy and example-robot-data everywhere"
        ) from error
    ours = fingerprint(sweep)
    if ours != sweep.program:
        arm = ", and the same file as robot.urdf" if own_urdfs(sweep) else ""
        raise ScenarioError(
            f"program {ours} on this worker, {sweep.program} asked; allowed: the same versions of vsmrc-lab, numba, "
            f"numpy, pin, scipy and example-robot-data everywhere{arm}"
        )
    return SweepRunner(sweep)
