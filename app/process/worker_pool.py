"""Pool of worker processes that compute a long row of tasks, and end with the process that started them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

AHEAD = 4  # tasks for each worker that are handed out before they can begin
TRIES = 2  # of a task whose process ends

Task = TypeVar("Task")
Part = TypeVar("Part")


class Chunk(tuple[Part, ...]):
    """Task of several parts, each of which could be a task of its own. Where its process ends, they are done one by
    one, so that a part that ends it each time takes no other one with it."""


class Fallen:
    """Result of a task whose process has ended at each of `TRIES` tries."""


class Barrier:
    """Barrier among tasks: no later task is taken before all earlier ones are done, since it may depend on them."""


FALLEN, BARRIER = Fallen(), Barrier()


def results(
    make: Callable[..., Callable[[Task], Any]],
    arguments: tuple[Any, ...],
    tasks: Iterable[Task | Barrier],
    workers: int,
) -> Iterator[tuple[Task, Any]]:
    """Tasks with their results, in the order in which they are done; `FALLEN` for a task whose process has ended twice.
    A `Chunk` whose process has ended comes as several chunks of one part. Only a few tasks are taken ahead, so there
    may be any number of them.

    make: called in each process, with the arguments; the function that it returns computes the tasks there. Raises what
    that function raises.
    """
    waiting: Iterator[_Handed[Any]] = (_Handed(task) for task in tasks)
    again: list[_Handed[Any]] = []
    while True:
        with _Pool(make, arguments, workers) as pool:
            try:
                yield from pool.done(waiting, again)
                return
            except BrokenProcessPool:
                for each in pool.under_way:
                    each.falls += 1
                    if each.falls < TRIES:
                        again.extend(each.parts)
                    else:
                        yield each.task, FALLEN


@dataclass(eq=False)
class _Handed(Generic[Task]):
    """Task that was handed out, and how often its process has ended."""

    task: Task
    falls: int = 0

    @property
    def parts(self) -> list[_Handed[Any]]:
        """The parts of a chunk, each as a chunk of its own; of another task the task itself."""
        if not isinstance(self.task, Chunk):
            return [self]
        return [_Handed(Chunk((part,)), self.falls) for part in self.task]


class _Pool:
    def __init__(self, make: Callable[..., Any], arguments: tuple[Any, ...], workers: int) -> None:
        # spawned, since the fork of a process that has threads may hang
        context = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(workers, context, _Process.begin, (make, arguments))
        self._futures: dict[Future[Any], _Handed[Any]] = {}
        self._most = workers * AHEAD

    def __enter__(self) -> _Pool:
        return self

    def __exit__(self, *_: object) -> None:
        processes = list(self._pool._processes.values())
        try:
            # waited for: the interpreter at its end would wait for ever for processes that wait for tasks
            self._pool.shutdown(wait=True, cancel_futures=True)
        except KeyboardInterrupt:  # a second Ctrl-C
            for process in processes:
                process.terminate()
            raise

    @property
    def under_way(self) -> list[_Handed[Any]]:
        """Tasks that were handed out and are not done."""
        return list(self._futures.values())

    def done(self, tasks: Iterator[_Handed[Any]], first: list[_Handed[Any]]) -> Iterator[tuple[Any, Any]]:
        """Tasks with their results. Those of `first` come before the others and one by one, so that a process that ends
        takes only one of them with it. Raises BrokenProcessPool where a process has ended."""
        while first:
            self._hand(first.pop(0))
            yield self._taken(next(iter(self._futures)))
        stopped = False  # at a barrier
        while True:
            while not stopped and len(self._futures) < self._most and (each := next(tasks, None)):
                stopped = each.task is BARRIER
                if not stopped:
                    self._hand(each)
            if not self._futures:
                if not stopped:
                    return
                stopped = False
                continue
            for future in wait(self._futures, return_when=FIRST_COMPLETED).done:
                yield self._taken(future)

    def _hand(self, each: _Handed[Any]) -> None:
        try:
            with _interrupts_blocked():  # here workers are started
                future = self._pool.submit(_Process.compute, each.task)
            self._futures[future] = each
        except BrokenProcessPool:
            self._futures[Future()] = each
            raise

    def _taken(self, future: Future[Any]) -> tuple[Any, Any]:
        result = future.result()  # first: a task whose process has ended is still under way
        return self._futures.pop(future).task, result


class _Process:
    """A process of the pool: the function that computes its tasks.

    A terminal sends Ctrl-C to it, too. That ends its tasks but not the process, which would print a traceback: the
    process that started it ends it."""

    function: Callable[[Any], Any]
    computing = interrupted = False

    @classmethod
    def begin(cls, make: Callable[..., Callable[[Any], Any]], arguments: tuple[Any, ...]) -> None:
        _end_with_parent()
        if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # as where a script has started the program with &
            signal.signal(signal.SIGINT, cls.interrupt)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        cls.function = staticmethod(make(*arguments))

    @classmethod
    def compute(cls, task: Any) -> Any:
        try:
            cls.computing = True
            if cls.interrupted:
                raise KeyboardInterrupt  # the pool cannot take back what it has handed out
            return cls.function(task)
        finally:
            cls.computing = False

    @classmethod
    def interrupt(cls, *_: object) -> None:
        cls.interrupted = True
        if cls.computing:
            raise KeyboardInterrupt


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Context in which Ctrl-C is blocked in this thread, and in processes that it starts, until they can handle it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    try:
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # may raise KeyboardInterrupt, so not before `try`
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_parent() -> None:
    """End a worker of the pool when its owner ends: it would wait for ever for an owner that was killed."""

    def watch() -> None:
        if owner := multiprocessing.parent_process():
            owner.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
