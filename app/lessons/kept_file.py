"""File of a session's folder in which lessons keep something as JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Generic, TypeVar

import msgspec

from app.process.atomic_write import write_whole

LARGEST = 16_000_000  # bytes of a file
_PRIVATE = 0o600

T = TypeVar("T")


class KeptFile(Generic[T]):
    """File that keeps one value of a type. path: of the file; what: of it, in a sentence."""

    def __init__(self, path: Path, kind: type[T], what: str) -> None:
        self._path, self._kind, self._what = path, kind, what

    def read(self) -> tuple[T | None, str]:
        """What was kept, None without it; and a sentence where it cannot be read, else "". A file that makes no sense
        is set aside. Raises OSError where that cannot be done."""
        try:
            with self._path.open("rb") as file:
                return msgspec.json.decode(file.read(LARGEST), type=self._kind), ""
        except FileNotFoundError:
            return None, ""
        except OSError as error:
            return None, f"{self._what} cannot be read: {error.strerror}; it is kept as {self._path}"
        except msgspec.DecodeError as error:
            aside = self._path.with_name(f"set-aside-{self._path.name}")
            self._path.replace(aside)
            return None, f"{self._what} cannot be read: {error}; it is kept as {aside}"

    def write(self, value: T) -> None:
        """Keep this value. Raises OSError where it cannot be written."""
        text = msgspec.json.format(msgspec.json.encode(value)) + b"\n"
        write_whole(self._path, lambda file: file.write(text), _PRIVATE)
