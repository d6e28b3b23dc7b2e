"""Slots of a server: each lets one of its processes compute something long; processes without a slot wait."""

from __future__ import annotations

import fcntl
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from app.process.kernel_cache import cache_folder

EVERY = 0.2  # s, between two looks for a free slot


@contextmanager
def held(count: int | None, while_waiting: Callable[[], object]) -> Iterator[None]:
    """Context in which this process holds one of `count` slots, which all processes with the same cache folder share;
    no slot is needed where count is None. Waits for a free slot, and calls `while_waiting` now and then meanwhile. A
    process that ends in any way gives its slot back. Raises OSError where the slots' files cannot be made."""
    if count is None:
        yield
        return
    folder = cache_folder() / "slots"
    folder.mkdir(exist_ok=True)
    while True:
        for number in range(count):
            with (folder / f"{number}.lock").open("w") as file:
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    continue
                yield
                return
        while_waiting()
        time.sleep(EVERY)
