"""Resources of a running process, as Linux reports them."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path


def memory(pid: int) -> int:
    """Memory in bytes; shared memory is divided among the processes. Raises OSError for a process that has ended."""
    text = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii")
    found = re.search(r"^Pss:\s+(\d+) kB", text, re.MULTILINE)
    return int(found[1]) * 1024 if found else 0


def threads(pid: int) -> int:
    """Number of threads. Raises OSError for a process that has ended."""
    return sum(1 for _ in Path(f"/proc/{pid}/task").iterdir())


def files(pid: int) -> int:
    """Number of open files. Raises OSError for a process that has ended."""
    return sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir())


def descendants(pid: int) -> Iterator[int]:
    """Children of a process, and their descendants."""
    with contextlib.suppress(OSError):  # it may just have ended
        for children in Path(f"/proc/{pid}/task").glob("*/children"):
            for child in map(int, children.read_text(encoding="ascii").split()):
                yield child
                yield from descendants(child)
