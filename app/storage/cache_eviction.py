"""Eviction of files from a cache folder, whose files can be made again."""

from __future__ import annotations

from itertools import islice
from pathlib import Path


def evict(folder: Path, kept: int) -> None:
    """Remove half of the files of a folder where it has `kept` of them or more. Raises OSError."""
    files = list(islice(folder.iterdir(), kept))
    if len(files) == kept:
        for file in files[: kept // 2]:
            file.unlink(missing_ok=True)
