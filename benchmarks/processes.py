"""What Linux says of a running process."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path


def memory(pid: int) -> int:
    """Bytes, what it shares with others divided among them. Raises OSError for a process that has ended."""
    text = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii")
    found = re.search(r"^Pss:\s+(\d+) kB", text, re.MULTILINE)
    return int(found[1]) * 1024 if found else 0


def threads(pid: int) -> int:
    """How many. Raises OSError for a process that has ended."""
    return sum(1 for _ in Path(f"/proc/{pid}/task").iterdir())


def files(pid: int) -> int:
    """How many are open. Raises OSError for a process that has ended."""
    return sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir())


def descendants(pid: int) -> Iterator[int]:
    """Its children, and theirs."""
    with contextlib.suppress(OSError):  # it may just have ended
        for children in Path(f"/proc/{pid}/task").glob("*/children"):
            for child in map(int, children.read_text(encoding="ascii").split()):
                yield child
                yield from descendants(child)
