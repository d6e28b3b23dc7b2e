"""The pool of worker processes: every task once, whatever falls."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from app.process.worker_pool import AHEAD, BARRIER, FALLEN, Barrier, Chunk, Fallen, results

ROOT = Path(__file__).parents[2]


def squares(deadly: int, wrong: int) -> Callable[[int], int]:
    def square(number: int) -> int:
        if number == deadly:
            os._exit(7)
        if number == wrong:
            raise ValueError("not this one")
        return number * number

    return square


@pytest.mark.slow
def test_a_task_whose_process_ends_is_told_and_all_others_are_done() -> None:
    found = dict(results(squares, (17, -1), range(60), 2))
    assert len(found) == 60
    assert isinstance(found.pop(17), Fallen)
    assert found == {number: number * number for number in range(60) if number != 17}
    assert isinstance(FALLEN, Fallen)


def squares_of(deadly: int) -> Callable[[tuple[int, ...]], list[int]]:
    square = squares(deadly, -1)
    return lambda numbers: [square(number) for number in numbers]


@pytest.mark.slow
def test_a_part_that_ends_its_process_takes_no_other_part_of_its_chunk_with_it() -> None:
    chunks = [Chunk(range(begun, begun + 4)) for begun in range(0, 40, 4)]
    found = list(results(squares_of, (17,), chunks, 2))
    assert [chunk for chunk, result in found if isinstance(result, Fallen)] == [(17,)]
    squared = {number: each for chunk, of in found if chunk != (17,) for number, each in zip(chunk, of, strict=True)}
    assert squared == {number: number * number for number in range(40) if number != 17}
    assert sum(len(chunk) for chunk, _ in found) == 40  # nothing twice


@pytest.mark.slow
def test_few_tasks_are_taken_ahead_and_an_error_ends_it() -> None:
    taken: list[int] = []

    def endless() -> Iterator[int]:
        number = 0
        while True:
            taken.append(number)
            yield number
            number += 1

    seen = 0
    with pytest.raises(ValueError, match="not this one"):  # noqa: PT012
        for task, result in results(squares, (-1, 30), endless(), 2):
            assert result == task * task
            seen += 1
            assert len(taken) <= seen + 2 * AHEAD


# A program that gives up while its workers wait for tasks, as a command does whose disk is full.
GIVES_UP = """
from app.process.deadline import end
from app.process.worker_pool import results
from tests.process.test_worker_pool import squares

def tried():
    try:
        for number, (task, result) in enumerate(results(squares, (-1, -1), range(60), 1)):
            if number == 7:
                raise OSError("full")
    except OSError:
        return 3

if __name__ == "__main__":
    end(tried())
"""


@pytest.mark.slow
def test_a_program_that_gives_up_among_its_tasks_ends(tmp_path: Path) -> None:
    program = tmp_path / "gives_up.py"
    program.write_text(GIVES_UP)
    ended = subprocess.run(
        [sys.executable, program], cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(ROOT)}, timeout=300
    )
    assert ended.returncode == 3


# A program of which Ctrl-C stops one worker that computes for minutes, and one that waits for tasks or still imports.
INTERRUPTED = """
import sys
import time
from app.process.worker_pool import results

def make():
    return time.sleep

def tasks():
    yield 300.0
    yield 0.01
    if sys.argv[1] == "imports":
        print("now", flush=True)

if __name__ == "__main__":
    try:
        for task, _ in results(make, (), tasks(), 2):
            print("now", flush=True)
    except KeyboardInterrupt:
        sys.exit(130)
else:
    time.sleep(0.5)  # a worker
"""


@pytest.mark.slow
@pytest.mark.parametrize("idle", ["waits", "imports"])
def test_ctrl_c_ends_a_program_at_once_and_no_worker_prints_a_traceback(tmp_path: Path, idle: str) -> None:
    path = tmp_path / "interrupted.py"
    path.write_text(INTERRUPTED)
    with subprocess.Popen(
        [sys.executable, path, idle],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as program:
        assert program.stdout is not None
        try:
            assert program.stdout.readline() == "now\n"
            time.sleep(0.2)
            os.killpg(program.pid, signal.SIGINT)  # as a terminal does it
            _, errors = program.communicate(timeout=60)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(program.pid, signal.SIGKILL)
    assert program.returncode == 130
    assert errors == ""


@pytest.mark.slow
def test_no_task_is_taken_over_a_barrier_before_all_earlier_ones_are_done() -> None:
    found: list[int] = []

    def rounds() -> Iterator[int | Barrier]:
        for begun in range(0, 12, 4):
            assert sorted(found) == list(range(begun))  # also where the process of one of them has ended
            yield from range(begun, begun + 4)
            yield BARRIER
            yield BARRIER

    for task, _ in results(squares, (5, -1), rounds(), 2):
        found.append(task)
    assert sorted(found) == list(range(12))
