"""Process that computes a sweep for the page: `python -m app.workers.sweep FD`, started by `app.sweep.background`."""

from __future__ import annotations

import os
import sys
from multiprocessing.connection import Connection

import structlog

from app.process import worker_pool
from app.process.log import configure_as_parent
from app.sweep.figures_of_run import Runner
from app.sweep.question import Sweep
from app.sweep.running import rows_of, tasks_of

log = structlog.get_logger()

NICENESS = 19  # the loop comes first


def main() -> None:
    configure_as_parent()
    os.nice(NICENESS)
    with Connection(int(sys.argv[1])) as asker:
        sweep: Sweep
        sweep, numbers, workers = asker.recv()
        try:
            tasks = tasks_of(numbers, workers)
            for task, figures in worker_pool.results(Runner.computing, (sweep,), tasks, workers):
                for row in rows_of(sweep, task, figures):
                    asker.send(row)
        except (EOFError, ConnectionError):
            log.debug("nobody waits for the rest")


if __name__ == "__main__":
    main()
