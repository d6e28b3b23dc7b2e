"""Memory of the results of searches, so that each search is made once."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import numpy as np

MOST_ANSWERS = 4096  # answers in memory, each of a few numbers
MOST_RESULTS = 64  # in memory

Numbers = tuple[float, ...]
Part = str | bytes | float | np.ndarray
T = TypeVar("T")


class AnswerStore(Protocol):
    """Store in which answers outlive the process."""

    def read(self, key: str, count: int) -> Numbers | None:
        """The answer of `count` numbers of this key; None where there is none that can be trusted."""
        ...

    def write(self, key: str, numbers: Numbers) -> None:
        """Keep an answer, if that is possible."""
        ...


class Memory:
    """Memory of answers by what they depend on: in this process, and in a store where there is one."""

    def __init__(self, store: AnswerStore | None = None) -> None:
        self._store = store
        self._known: dict[str, Numbers] = {}
        self._results: dict[str, Any] = {}

    def recall(self, key: str, count: int, find: Callable[[], Numbers]) -> Numbers:
        """The answer of `count` numbers of this key, found where it is not known yet. Raises what `find` raises."""
        known = self._known.get(key)
        if known is None:
            known = self._store.read(key, count) if self._store is not None else None
            if known is None:
                known = tuple(float(number) for number in find())  # repr of numpy's numbers is different
                if self._store is not None:
                    self._store.write(key, known)
            if len(self._known) >= MOST_ANSWERS:
                self._known.clear()
            self._known[key] = known
        return known

    def recall_here(self, key: str, find: Callable[[], T]) -> T:
        """The result of this key, found where this process does not know it yet; nobody may change it. Raises what
        `find` raises."""
        if key not in self._results:
            found = find()
            if len(self._results) >= MOST_RESULTS:
                self._results.clear()
            self._results[key] = found
        return self._results[key]


def key_of(*parts: Part) -> str:
    """Key of an answer, from all that it depends on."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            content = f"{part.dtype.str}{part.shape}".encode() + np.ascontiguousarray(part).tobytes()
        elif isinstance(part, bytes):
            content = part
        else:
            content = repr(part).encode()
        digest.update(f"{type(part).__name__} {len(content)} ".encode() + content)
    return digest.hexdigest()
