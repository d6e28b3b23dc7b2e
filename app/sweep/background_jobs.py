"""Share of the machine that a session has for maps and searches: one at a time, and on a server for many a limited
one."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from app.process.cores import usable_cores
from app.scenario.errors import ScenarioError
from app.sweep.background import Background

B = TypeVar("B", bound=Background)


@dataclass(frozen=True)
class Allowance:
    """Allowance of one session for computations beside its loop.
    workers: number of processes at once.
    at_once: number of maps and searches of all sessions of the server at the same time; None: any number.
    runs: of one map or search; None: any number."""

    workers: int
    at_once: int | None = None
    runs: int | None = None

    def __str__(self) -> str:
        by = f"{self.workers} of this machine's {usable_cores()} cores"
        if self.runs is None or self.at_once is None:
            return by
        return (
            f"{by}, since this server is shared: one map or search of yours at a time, of at most {self.runs:,} runs, "
            f"and at most {self.at_once} of all visitors together; others wait"
        )


def allowance_of(*, shared: bool) -> Allowance:
    """Allowance of a session of this machine: all cores but one, or one core where the machine is shared."""
    spare = max(1, usable_cores() - 1)
    return Allowance(1, spare, 1500) if shared else Allowance(spare)


class BackgroundJobs:
    """Share of one session: starts its maps and searches, one at a time. May be used from any thread."""

    def __init__(self, allowance: Allowance) -> None:
        self.allowance = allowance
        self._lock = threading.Lock()
        self._last: Background | None = None

    def begin(self, start: Callable[[Allowance], B], runs: int) -> B:
        """Start a computation. Raises ScenarioError where it has too many runs, or another computation of this session
        goes on. runs: their number."""
        most = self.allowance.runs
        if most is not None and runs > most:
            raise ScenarioError(
                f"{runs:,} runs; allowed: at most {most:,}, since this server is shared: with fewer steps, arms or "
                "candidates"
            )
        with self._lock:
            if self._last is not None and self._last.going:
                raise ScenarioError(f"{self._last.noun}: one is going on; allowed: after its end, or Cancel there")
            begun = start(self.allowance)
            self._last = begun
            return begun

    def close(self) -> None:
        """End the computation that goes on, if there is one."""
        with self._lock:
            if self._last is not None:
                self._last.cancel()
