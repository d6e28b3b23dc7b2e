"""Atomic write of files: a file is there as a whole or not at all."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import structlog

log = structlog.get_logger()


def write_whole(path: Path, write: Callable[[BinaryIO], object], mode: int = 0o666, *, synced: bool = True) -> None:
    """Write a file atomically: the file at `path` becomes what `write` writes. Until then the old file stays, also when
    `write` fails, the process is killed or the machine stops. A process that is killed can leave ".NAME.NUMBER" beside
    the file, with the number of its thread. Raises OSError, and what `write` raises.

    mode: permissions, of which the user's umask may take some away.
    synced: whether it is on the disk on return, as far as its file system can flush; else a power cut may lose the
        file, and nothing waits for the disk.
    """
    being_written = path.with_name(f".{path.name}.{threading.get_native_id()}")
    try:
        with open(being_written, "wb", opener=lambda name, flags: os.open(name, flags, mode)) as file:
            write(file)
            if synced:
                file.flush()
                os.fsync(file.fileno())
        being_written.replace(path)
    finally:
        being_written.unlink(missing_ok=True)
    if synced:
        _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    """Flush this folder to disk, so that a file moved in it stays moved. Where that fails it is only logged: the new
    file is in place, and whoever was told that it cannot be written would go on with what the old one says."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as error:  # some file systems flush no folder
        log.info("folder not flushed", folder=str(folder), reason=error.strerror)
