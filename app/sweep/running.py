"""Running of a sweep on all cores: what it will take, and all of its runs that are not done yet."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
from tqdm import tqdm

from app.process import worker_pool
from app.sweep.figures_of_run import Figures, Runner
from app.sweep.question import Question, Sweep
from app.sweep.run_store import RunStore

BYTES = 90  # of a run on disk, measured (docs/sweeps.md)
CHUNK = 8  # runs that a process takes at once, at most
COMPUTED = ("app/analysis", "app/scenario", "app/session", "app/simulation", "app/sweep", "controllers", "environments",
            "kernels", "parameters")  # fmt: skip


@dataclass(frozen=True)
class Estimate:
    """What a sweep will take: runs that are left, their simulated time and the computing time on so many cores (s), and
    bytes on disk."""

    runs: int
    simulated: float
    seconds: float
    size: float

    def __str__(self) -> str:
        return (
            f"{self.runs} runs of {self.simulated:.4g} s simulated time in all: about {_duration(self.seconds)}, "
            f"{self.size / 1e6:.2g} MB"
        )


def _duration(seconds: float) -> str:
    for size, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.2g} s"


def fingerprint() -> str:
    """Fingerprint of all that the figures of a run depend on besides the sweep: this program, and the libraries that
    compute."""
    root, digest = Path(__file__).parents[2], hashlib.sha256()
    for package in COMPUTED:
        for file in sorted((root / package).rglob("*.py")):
            digest.update(file.relative_to(root).as_posix().encode() + file.read_bytes())
    digest.update(" ".join(f"{name} {version(name)}" for name in ("numba", "numpy", "pin", "scipy")).encode())
    return digest.hexdigest()[:16]


def estimated(sweep: Sweep, left: int, workers: int | None = None) -> Estimate:
    """What so many runs of a sweep will take, from the computing time of one of them. It is played twice: the first
    time, what all have in common is computed, too."""
    question, runner = Question(sweep), Runner(sweep)
    number = question.count // 2
    seconds = [_seconds(runner, number) for _ in range(2)][-1] if left else 0.0
    share = left / question.count
    return Estimate(left, share * question.seconds, left * seconds / (workers or os.cpu_count() or 1), left * BYTES)


def _seconds(runner: Runner, number: int) -> float:
    started = time.perf_counter()
    runner.figures(number)
    return time.perf_counter() - started


def run(store: RunStore, sweep: Sweep, workers: int | None = None, *, show_progress: bool = False) -> int:
    """Compute the runs that are not done, on all cores or so many. Returns how many stopped or were refused.

    Raises OSError where they cannot be written; what was written stays.
    """
    workers = workers or os.cpu_count() or 1
    left = int((~store.done).sum())
    failed = 0
    with tqdm(total=left, unit=" runs", desc="sweep", disable=not show_progress) as bar:
        for numbers, figures in worker_pool.results(_computer, (sweep,), _tasks(store.done, workers), workers):
            for each in _rows(sweep, numbers, figures):
                store.add(each)
                failed += bool(each.get("stopped"))
            bar.set_postfix_str(f"{failed} stopped or refused" if failed else "")
            bar.update(len(numbers))
    store.settle()
    return failed


def _tasks(done: np.ndarray, workers: int) -> Iterator[tuple[int, ...]]:
    """Numbers of the missing runs, a few at a time; towards the end fewer."""
    missing = np.flatnonzero(~done).tolist()
    at = 0
    while at < len(missing):
        size = max(1, min(CHUNK, (len(missing) - at) // (4 * workers)))
        yield tuple(missing[at : at + size])
        at += size


def _rows(sweep: Sweep, numbers: tuple[int, ...], figures: list[Figures] | worker_pool.Fallen) -> list[Figures]:
    if not isinstance(figures, worker_pool.Fallen):
        return figures
    question = Question(sweep)
    return [question.told(question.row(n)) | {"stopped": "the process that computed it has ended"} for n in numbers]


def _computer(sweep: Sweep) -> Callable[[tuple[int, ...]], list[Figures]]:
    runner = Runner(sweep)
    return lambda numbers: [runner.figures(number) for number in numbers]
