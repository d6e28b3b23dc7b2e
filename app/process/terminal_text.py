"""Text for a terminal or a log."""

from __future__ import annotations

import os
import sys

LONGEST = 1000  # characters


def printable(text: str) -> str:
    """Text of one line that is safe on a terminal: control characters, escape sequences and characters that turn the
    direction of writing are written as Python writes them, and a very long text is cut."""
    shown = text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode() for c in shown)


def drop_output() -> None:
    """Drop what is printed on standard output from now on, and what waits there."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def stand_in() -> None:
    """Open what drops everything in place of standard input, output and error that were closed when the program began,
    as by `>&-`: else the next file that is opened takes their numbers."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)  # the system gives the lowest number that is free
            os.set_inheritable(nowhere, True)  # a child, too, begins with all three
    if sys.stdout is None:
        sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115  # for as long as the program
    if sys.stderr is None:
        sys.stderr = open(2, "w", closefd=False)  # noqa: SIM115


def print_line(text: str) -> None:
    """Print a line on standard output, as long as somebody reads there: a terminal may have been closed, a pipe
    ended."""
    try:
        print(text, flush=True)
    except OSError:
        drop_output()
