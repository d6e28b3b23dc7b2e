"""Files that are there as a whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO


def write_whole(path: Path, write: Callable[[BinaryIO], object], mode: int = 0o666) -> None:
    """What `write` writes becomes the file at `path`; what was there stays until then, also when it fails, the process
    is killed or the machine stops. Raises OSError, and what `write` raises.

    mode: who may read it, of what the user's umask allows. A process that is killed can leave ".NAME.NUMBER" beside it.
    """
    being_written = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with open(being_written, "wb", opener=lambda name, flags: os.open(name, flags, mode)) as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        being_written.replace(path)
    finally:
        being_written.unlink(missing_ok=True)
    _settle(path.parent)


def _settle(folder: Path) -> None:
    """What was moved in this folder stays moved."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
