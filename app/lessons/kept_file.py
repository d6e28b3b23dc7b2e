"""JSON file of a session's folder for the progress in lessons or for the answers of a class."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Generic, TypeVar

import msgspec

from app.process.atomic_write import write_whole
from app.storage.session_index import StateError
from environments.regular_file import read_regular

LARGEST = 64_000_000  # bytes of a file: 800 curves drawn by a hundred students
_PRIVATE = 0o600

T = TypeVar("T")


class KeptFile(Generic[T]):
    """JSON file that keeps one value.
    kind: type of the value.
    what: name of the value in sentences to the user."""

    def __init__(self, path: Path, kind: type[T], what: str) -> None:
        self._path, self._kind, self._what = path, kind, what

    def read(self) -> tuple[T | None, str]:
        """Value of the file, None where there is none, and a sentence where the file cannot be read, else "". A file
        that cannot be read is renamed, so that it is not overwritten. Raises StateError where it cannot be renamed."""
        try:
            return msgspec.json.decode(read_regular(self._path, LARGEST + 1), type=self._kind), ""
        except FileNotFoundError:
            return None, ""
        except (OSError, msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            aside = self._path.with_name(f"set-aside-{self._path.name}")
            reason = error.strerror if isinstance(error, OSError) else error
            try:
                self._path.replace(aside)
            except OSError as stays:
                raise StateError(
                    f"{self._path}: {self._what} cannot be read: {reason}, nor be set aside: {stays.strerror}"
                ) from stays
            return None, f"{self._what} cannot be read: {reason}; it is kept as {aside}"

    def write(self, value: T) -> None:
        """Write the value to the file. Raises OSError where it cannot be written, or would be too large to be read."""
        text = msgspec.json.format(msgspec.json.encode(value)) + b"\n"
        if len(text) > LARGEST:
            raise OSError(errno.EFBIG, os.strerror(errno.EFBIG))
        write_whole(self._path, lambda file: file.write(text), _PRIVATE)
