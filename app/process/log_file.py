"""Log file that several processes write to and whose size is limited."""

from __future__ import annotations

import fcntl
import os
import stat
from pathlib import Path

LARGEST = 10_000_000  # bytes; then the file gets a number, and another one is begun
OLDER = 3  # numbered files that are kept: FILE.1 is the newest


class GrowingLog(OSError):
    """Error of a log file that has reached its limit and cannot be renamed; its lines are written."""


class LogFile:
    """Log file to which lines are appended: each by one call of the system, so that those of several processes do not
    mix.

    The process that finds the file too large renames it and opens a new one; the other processes follow, also when
    another program renames the file. Where its folder takes no other file, it grows. Raises OSError where the file
    cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._stuck = path.absolute(), False  # where it cannot be renamed, it grows
        self._descriptor = _opened(self._path)

    def write(self, line: str) -> None:
        """Append a line. Raises OSError, also for a line that does not fit on the disk as a whole, and GrowingLog after
        the first line beyond the limit where the file cannot be renamed."""
        data = line.encode(errors="backslashreplace")
        self._follow()
        status = os.fstat(self._descriptor)
        large = stat.S_ISREG(status.st_mode) and status.st_size + len(data) > LARGEST
        failure = self._try_to_move_on() if large and not self._stuck else None
        if (written := os.write(self._descriptor, data)) < len(data):
            raise OSError(f"{self._path}: {written} of {len(data)} bytes of a line fit")
        if failure is not None:
            raise failure

    def close(self) -> None:
        os.close(self._descriptor)

    def _follow(self) -> None:
        """Open the file that is at the path now."""
        try:
            same = os.path.samestat(os.stat(self._path), os.fstat(self._descriptor))
        except FileNotFoundError:
            same = False
        if not same:
            another = _opened(self._path)
            os.close(self._descriptor)
            self._descriptor, self._stuck = another, False

    def _try_to_move_on(self) -> GrowingLog | None:
        """Begin another file; the error where that fails, and is not tried again."""
        try:
            self._move_on()
        except FileNotFoundError:  # another program has moved it just now: the next line follows
            return None
        except OSError as error:
            self._stuck = True
            return GrowingLog(error.errno, f"{self._path} cannot be renamed ({error.strerror}), so it grows")
        return None

    def _move_on(self) -> None:
        """Rename the file, unless another process has done so: then another file is at the path."""
        fcntl.flock(self._descriptor, fcntl.LOCK_EX)
        try:
            if os.path.samestat(os.stat(self._path), os.fstat(self._descriptor)):
                for number in range(OLDER, 0, -1):
                    if (newer := self._numbered(number - 1)).exists():
                        newer.replace(self._numbered(number))
        finally:
            fcntl.flock(self._descriptor, fcntl.LOCK_UN)
        self._follow()

    def _numbered(self, number: int) -> Path:
        return self._path.with_name(f"{self._path.name}.{number}") if number else self._path


def _opened(path: Path) -> int:
    return os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o600)
