"""Runs of a sweep on other machines: Dask schedules, repeats and balances them; this is its client."""

from __future__ import annotations

import asyncio
import logging
import pickle
import queue
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from app.process.worker_pool import FALLEN, Fallen
from app.scenario.errors import ScenarioError
from app.sweep import cluster_worker
from app.sweep.plan import Sweep
from app.sweep.run_metrics import RunMetrics

if TYPE_CHECKING:
    from distributed import Client, Future

CHUNK = 16  # runs of a task (docs/scale.md)
AHEAD = 3  # tasks for each worker that are handed out, so that none waits for this process
CONNECT = 10.0  # s until a scheduler has to answer
LOOK = 1.0  # s between two looks at how many workers there are
NOBODY = "no worker there: start one with `dask worker {}`"


class Cluster:
    """Client of a Dask scheduler at an address such as tcp://127.0.0.1:8786.

    Raises ScenarioError where there is none, or where the extra `cluster` is not installed.
    """

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
        except ImportError as error:
            raise ScenarioError(
                "--scheduler: Dask is not installed; allowed: after `pip install 'vsmrc-lab[cluster]'`"
            ) from error
        for name in ("distributed", "distributed.client"):  # lost workers are reported by this program, in a sentence
            logging.getLogger(name).setLevel(logging.CRITICAL)
        self._address = address
        try:
            asyncio.run(_require_answer(address))
            self._client: Client = Client(address, timeout=CONNECT, set_as_default=False)
        except TypeError as error:  # of Dask, for tls:// without the files that it needs
            raise ScenarioError(
                f"--scheduler {address!r:.100}: this needs certificates; allowed: with those of the scheduler in "
                "Dask's configuration (distributed.comm.tls), or a tcp:// address in a network that you trust"
            ) from error
        except (OSError, ValueError, RuntimeError, AssertionError) as error:  # the last one where its thread is late
            raise ScenarioError(
                f"--scheduler {address!r:.100}: no scheduler answers; allowed: the address that `dask scheduler` "
                "tells, such as tcp://127.0.0.1:8786"
            ) from error

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.close(timeout=LOOK)

    @property
    def workers(self) -> int:
        """Number of workers that are there now. Raises ScenarioError where the scheduler is lost."""
        if self._client.status != "running":
            raise self._lost()
        try:
            threads: Any = self._client.nthreads()
        except (OSError, AttributeError) as error:  # AttributeError: the client closes meanwhile
            raise self._lost() from error
        return len(threads)

    def results(
        self, sweep: Sweep, numbers: Sequence[int], notify: Callable[[str], object], chunk: int = CHUNK
    ) -> Iterator[tuple[tuple[int, ...], list[RunMetrics] | Fallen]]:
        """Runs by their numbers with their metrics, in the order in which they are done; `FALLEN` for a run whose
        worker has ended each time, also with no other run beside. Only a few are handed out ahead, so there may be any
        number of them.

        notify: called with a sentence when there is no worker, and when there is one again.
        chunk: largest number of runs of a task.

        Raises ScenarioError where the scheduler is lost, or a worker has another version of the program.
        """
        pickled, waiting, alone = pickle.dumps(sweep), deque(numbers), deque[int]()
        done: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        under_way: dict[Future[Any], tuple[int, ...]] = {}
        suspected: set[int] = set()  # runs whose worker has ended; from then on handed out alone
        workers, looked, lonely = 0, float("-inf"), False
        while waiting or alone or under_way:
            if time.monotonic() - looked > LOOK:
                workers, looked = self.workers, time.monotonic()
                if lonely != (workers == 0):
                    lonely = not lonely
                    notify(NOBODY.format(self._address) if lonely else "a worker has come")
            for task in _ready(waiting, alone, len(under_way), workers, chunk):
                future = self._submitted(pickled, task)
                under_way[future] = task
                future.add_done_callback(done.put)
            try:
                future = done.get(timeout=LOOK)
            except queue.Empty:
                continue
            task = under_way.pop(future)
            metrics = self._metrics(future)
            if metrics is FALLEN and not suspected.issuperset(task):
                suspected.update(task)
                alone.extend(task)
            else:
                yield task, metrics

    def _submitted(self, pickled: bytes, task: tuple[int, ...]) -> Future[Any]:
        """Future of a task that is handed to the scheduler. Raises ScenarioError where the client closes meanwhile."""
        from distributed.client import ClosedClientError

        try:
            return self._client.submit(cluster_worker.metrics, pickled, task, pure=False)
        except ClosedClientError as error:
            raise self._lost() from error

    def _metrics(self, future: Future[Any]) -> list[RunMetrics] | Fallen:
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError

        try:
            return future.result()
        except KilledWorker:
            return FALLEN
        except FutureCancelledError as error:
            raise self._lost() from error
        except ScenarioError as error:
            raise ScenarioError(f"--scheduler {self._address}: {error}") from error
        except (ImportError, AttributeError, OSError) as error:
            raise ScenarioError(
                f"--scheduler {self._address}: a worker cannot run it: {error}; allowed: workers with the same "
                "version of vsmrc-lab, and room for its compiled kernels"
            ) from error

    def _lost(self) -> ScenarioError:
        return ScenarioError(
            f"--scheduler {self._address}: the connection is lost; what was computed is kept, and the same command "
            "goes on once the scheduler is there"
        )


def _ready(
    waiting: deque[int], alone: deque[int], under_way: int, workers: int, chunk: int
) -> Iterator[tuple[int, ...]]:
    """Tasks to hand out now, each the numbers of its runs.
    waiting: runs that are handed out in chunks, smaller ones towards the end.
    alone: runs that are handed out one by one with no other task beside, since Dask gives up all tasks of a worker that
    has ended."""
    if alone:
        if not under_way:
            yield (alone.popleft(),)
        return
    workers = max(workers, 1)
    while waiting and under_way < workers * AHEAD:
        size = max(1, min(chunk, len(waiting) // (4 * workers)))
        yield tuple(waiting.popleft() for _ in range(size))
        under_way += 1


async def _require_answer(address: str) -> None:
    """Connect to a scheduler once. Raises OSError, and ValueError or TypeError for an address that Dask cannot use.

    A client of Dask that does not find its scheduler stays half built, with a thread; it blocks whatever client is made
    while Python's garbage collector ends it.
    """
    from distributed.comm.core import connect
    from distributed.security import Security

    security = Security().get_connection_args("client")
    comm = await connect(address, timeout=CONNECT, **security)
    await comm.close()
