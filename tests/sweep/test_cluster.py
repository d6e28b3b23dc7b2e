"""Sweeps on a cluster: a real scheduler of Dask, and workers that come, go and fall."""

from __future__ import annotations

import itertools
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import msgspec
import pytest

from app.cli.commands import execute
from app.process.worker_pool import FALLEN
from app.scenario.data import edited, shipped
from app.scenario.errors import ScenarioError
from app.sweep import cluster, cluster_worker, running
from app.sweep.axes import axis_of
from app.sweep.cluster import Cluster
from app.sweep.fingerprint import fingerprint
from app.sweep.plan import Sweep, SweepPlan
from app.sweep.run_metrics import ENDED, RunMetrics, SweepRunner
from app.sweep.run_store import RunStore
from drivers.cluster import Scheduler, worker
from drivers.cluster import scheduler as started
from drivers.waiting import until

pytestmark = pytest.mark.slow

SHORT = edited(shipped()["planar3r-hybrid"], "simulation.duration", 0.3)
SWEEP = Sweep(SHORT, (axis_of("contact.K_e=1e3:1e4:20:log"),), draw=2, program=fingerprint())
FALLING, SOME = 5, 10  # the run that ends its worker, and so many runs before something else ends


def falls() -> None:
    """Make the run `FALLING` end its process, as a fault in a library would; for a worker's --preload."""
    metrics = SweepRunner.metrics

    def with_a_fault(self: SweepRunner, number: int) -> RunMetrics:
        if number == FALLING:
            os._exit(1)
        return metrics(self, number)

    SweepRunner.metrics = with_a_fault


def hangs() -> None:
    """Make a process compute `SOME` runs, and then nothing more; for a worker's --preload."""
    metrics, begun = SweepRunner.metrics, itertools.count()

    def until_some(self: SweepRunner, number: int) -> RunMetrics:
        if next(begun) >= SOME:
            threading.Event().wait()
        return metrics(self, number)

    SweepRunner.metrics = until_some


def run_until_killed(*arguments: str) -> None:
    """The command, killed when it has kept `SOME` rows."""
    add, kept = RunStore.add, itertools.count(1)

    def add_and_end(self: RunStore, metrics: RunMetrics) -> None:
        add(self, metrics)
        if next(kept) == SOME:
            os.kill(os.getpid(), signal.SIGKILL)

    RunStore.add = add_and_end
    execute(list(arguments))


@pytest.fixture(scope="module", name="scheduler")
def a_scheduler() -> Iterator[Scheduler]:
    with started() as it:
        yield it


@pytest.fixture
def impatient() -> Iterator[Scheduler]:
    """A scheduler that gives up all tasks of a worker as soon as it has ended; no other test uses it."""
    with started(allowed_failures=0) as it:
        yield it


def timeless(rows: list[RunMetrics]) -> list[RunMetrics]:
    ordered = sorted(rows, key=lambda row: row["row"])
    return [
        {name: value for name, value in row.items() if name != "wall_time" and value is not None} for row in ordered
    ]


@pytest.fixture(scope="module")
def expected() -> list[RunMetrics]:
    """Rows of `SWEEP`, computed here."""
    runner = SweepRunner(SWEEP)
    return timeless([runner.metrics(number) for number in range(SweepPlan(SWEEP).count)])


def rows_of(folder: Path) -> list[RunMetrics]:
    with RunStore(folder, SWEEP) as store:
        return timeless(store.rows)


def test_rows_are_those_of_one_process_whichever_workers_come_and_go(
    scheduler: Scheduler, expected: list[RunMetrics], tmp_path: Path
) -> None:
    address, _ = scheduler
    with RunStore(tmp_path / "out", SWEEP) as store, Cluster(address) as cluster:
        sweeping = threading.Thread(target=running.run, args=(store, SWEEP, cluster), daemon=True)
        until(lambda: cluster.workers == 0)  # those of another test may not be signed off yet
        sweeping.start()
        with worker(address, "--no-nanny", "--preload", f"from {__name__} import hangs; hangs()") as first:
            until(lambda: bool(store.done.any()))
            with worker(address):
                until(lambda: cluster.workers == 2)
                os.killpg(first.pid, signal.SIGKILL)
                until(lambda: not sweeping.is_alive())
    assert rows_of(tmp_path / "out") == expected


def test_a_client_that_is_killed_comes_back_and_computes_the_rest(
    scheduler: Scheduler, expected: list[RunMetrics], tmp_path: Path
) -> None:
    address, _ = scheduler
    out = tmp_path / "out"
    with RunStore(out, SWEEP):
        pass  # its sweep.toml
    arguments = ["sweep", str(out / "sweep.toml"), "--out", str(out), "--scheduler", address]
    with worker(address), worker(address):
        killed = subprocess.run(
            [sys.executable, "-c", f"from {__name__} import run_until_killed; run_until_killed(*{arguments})"],
            check=False,
        )
        assert killed.returncode == -signal.SIGKILL
        assert len(rows_of(out)) == SOME
        assert execute(arguments) == 0
    assert rows_of(out) == expected


def test_a_run_that_ends_its_worker_each_time_is_a_row_and_the_others_are_computed(
    impatient: Scheduler, expected: list[RunMetrics], tmp_path: Path
) -> None:
    address, _ = impatient
    preload = f"from {__name__} import falls; falls()"
    with RunStore(tmp_path, SWEEP) as store, Cluster(address) as cluster:
        with worker(address, "--nworkers", "2", "--preload", preload):
            assert running.run(store, SWEEP, cluster) == 1
        rows = timeless(store.rows)
    fallen = rows.pop(FALLING)
    assert fallen["stopped"] == f"{ENDED}: the process that computed it has ended"
    assert rows == [row for row in expected if row["row"] != FALLING]


def test_a_run_whose_worker_has_ended_beside_others_is_tried_alone_before_it_is_given_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Dask gives up every task of a worker that has ended, also one that is a single run."""
    from distributed import KilledWorker

    handed: list[int] = []

    class Client:
        status = "running"

        def nthreads(self) -> dict[str, int]:
            return {"one": 1}

        def submit(self, _function: object, _asked: bytes, task: tuple[int, ...], **_: object) -> Future[Any]:
            (number,), future = task, Future[Any]()
            handed.append(number)
            if number == FALLING or (number == FALLING - 1 and handed.count(number) == 1):
                future.set_exception(KilledWorker("metrics", None, 3))
            else:
                future.set_result([{"row": number}])
            return future

        def close(self, timeout: float) -> None:
            pass

    answer_with(Client(), monkeypatch)
    with Cluster("tcp://127.0.0.1:1") as cluster:
        found = dict(cluster.results(SWEEP, range(FALLING + 1), print, chunk=1))
    assert [task for task, metrics in found.items() if metrics is FALLEN] == [(FALLING,)]
    assert sorted(found) == [(number,) for number in range(FALLING + 1)]
    assert handed.count(FALLING) == 2


def test_a_scheduler_that_is_lost_while_tasks_are_handed_out_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    from distributed.client import ClosedClientError

    class Client:
        status = "running"

        def nthreads(self) -> dict[str, int]:
            return {"one": 1}

        def submit(self, *_: object, **__: object) -> Future[Any]:
            raise ClosedClientError("Client is closed. Can't send update-graph message.")

        def close(self, timeout: float) -> None:
            pass

    answer_with(Client(), monkeypatch)
    with (
        Cluster("tcp://127.0.0.1:1") as cluster,
        pytest.raises(ScenarioError, match="the connection is lost; what was computed is kept"),
    ):
        list(cluster.results(SWEEP, range(3), print))


def test_a_sweep_with_parameters_of_a_law_of_ones_own_is_computed_by_a_worker() -> None:
    own = Sweep(edited(SHORT, "controller.own", {"pid-gravity": {"k_i": 800.0}}), program=fingerprint())
    assert timeless(cluster_worker.metrics(pickle.dumps(own), (0,))) == timeless([SweepRunner(own).metrics(0)])


def answer_with(client: object, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every address have a scheduler, whose client is this one."""

    async def answer(_address: str) -> None:
        pass

    monkeypatch.setattr(cluster, "_require_answer", answer)
    monkeypatch.setattr("distributed.Client", lambda *_, **__: client)


def test_what_is_wrong_is_one_sentence(impatient: Scheduler, monkeypatch: pytest.MonkeyPatch) -> None:
    address, process = impatient
    with monkeypatch.context() as without:  # a client that finds no scheduler would stay half built
        without.setattr("distributed.Client", None)
        with pytest.raises(ScenarioError, match="no scheduler answers; allowed: the address that"):
            Cluster("tcp://127.0.0.1:1")
    with pytest.raises(ScenarioError, match="no scheduler answers"):
        Cluster("nonsense://x")
    with pytest.raises(ScenarioError, match="this needs certificates; allowed: with those"):
        Cluster("tls://127.0.0.1:1")
    notices: list[str] = []
    with Cluster(address) as closed:
        pass
    other = msgspec.structs.replace(SWEEP, program="another")
    with Cluster(address) as cluster:
        with worker(address):
            with pytest.raises(ScenarioError, match="on this worker, another asked; allowed: the same versions"):
                list(cluster.results(other, range(3), notices.append))
            task, metrics = next(cluster.results(SWEEP, range(40), notices.append))
            assert isinstance(metrics, list)
            assert [each["row"] for each in metrics] == list(task)
        until(lambda: cluster.workers == 0)
        lonely = f"no worker there: start one with `dask worker {address}`"
        notices.clear()

        def notify(sentence: str) -> None:
            notices.append(sentence)
            if sentence == lonely:
                process.kill()

        with pytest.raises(ScenarioError, match="the connection is lost; what was computed is kept"):
            list(cluster.results(SWEEP, range(40), notify))
        for lost in (cluster, closed):
            with pytest.raises(ScenarioError, match="the connection is lost"):
                running.SweepEstimate.of(1, 1.0, 1.0, lost)
    assert notices == [lonely]
