"""Standard output and error of a command, which stop no work where they cannot be written."""

from __future__ import annotations

import io
import sys
from typing import TYPE_CHECKING, TextIO

from app.cli.status import FAULT
from app.process.terminal_text import printable, stand_in
from app.scenario.number_text import with_powers

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer


def told(sentence: str) -> str:
    """Sentence of the simulation, or a refusal, as a terminal shows it: numbers with powers of ten, and nothing of a
    file or of the user's own code that a terminal would carry out."""
    return printable(with_powers(sentence))


class _Output(io.FileIO):
    """Standard output or error. What nobody reads any more is dropped, as after `| head`, and so is what cannot be
    written. lost: the first error of the latter kind."""

    lost: OSError | None = None

    def write(self, data: ReadableBuffer, /) -> int:
        try:
            return super().write(data)
        except BrokenPipeError:
            pass
        except OSError as error:
            self.lost = self.lost or error
        return memoryview(data).nbytes


class CommandOutput:
    """Standard output and error of this process, from now on: neither a closed pipe nor a full disk nor a letter that
    a terminal does not know raises an error in the work that prints."""

    def __init__(self) -> None:
        stand_in()
        self._output = _Output(1, "w", closefd=False)
        sys.stdout = _text(self._output, sys.stdout)
        sys.stderr = _text(_Output(2, "w", closefd=False), sys.stderr)

    def status(self, status: int) -> int:
        """Exit status of a command that ends with `status`: a fault where some of its output is lost."""
        sys.stdout.flush()
        lost = self._output.lost
        if lost is None:
            return status
        print(f"vsmrc: standard output cannot be written: {lost.strerror}", file=sys.stderr)
        return status or FAULT


def _text(output: _Output, before: TextIO) -> TextIO:
    """Text stream to an output, which writes lines when the one before did."""
    at_once = isinstance(before, io.TextIOWrapper) and (before.line_buffering or before.write_through)
    return io.TextIOWrapper(
        io.BufferedWriter(output), before.encoding, errors="backslashreplace", line_buffering=at_once
    )
