"""Dask cluster on this machine: a scheduler and workers, processes that end with the context that started them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import msgspec

from drivers.waiting import until

ALLOWED_FAILURES = "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES"


class Scheduler(NamedTuple):
    """Scheduler of Dask."""

    address: str
    process: subprocess.Popen[bytes]


@contextmanager
def scheduler(allowed_failures: int = 1) -> Iterator[Scheduler]:
    """Context with a scheduler on a free port. allowed_failures: number of workers that a task may end before it is
    given up, fewer than those of Dask: each takes seconds to begin."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scheduler.json"
        options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
        with _started("scheduler", *options, environment={ALLOWED_FAILURES: str(allowed_failures)}) as process:
            until(lambda: file.exists() and file.read_bytes(), "no scheduler")
            yield Scheduler(msgspec.json.decode(file.read_bytes())["address"], process)


@contextmanager
def worker(address: str, *options: str) -> Iterator[subprocess.Popen[bytes]]:
    """Context with a worker of one thread in a process group of its own. options: of Dask's command line; `--nworkers`
    starts several workers."""
    with _started("worker", address, "--nthreads", "1", "--no-dashboard", *options) as process:
        yield process


@contextmanager
def _started(*command: str, environment: Mapping[str, str] | None = None) -> Iterator[subprocess.Popen[bytes]]:
    # Dask imports the text of --preload from the temporary folder, where files of others would hide our modules
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as own,
        subprocess.Popen(
            [sys.executable, "-m", "dask", *command],
            start_new_session=True,
            env={**os.environ, **(environment or {}), "TMPDIR": own},
            stderr=subprocess.DEVNULL,
        ) as process,
    ):
        try:
            yield process
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
