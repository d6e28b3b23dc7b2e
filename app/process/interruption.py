"""Interruption: a handler of Ctrl-C and other signals that loses none."""

from __future__ import annotations

from types import FrameType


class Interruption:
    """Handler of a signal that asks a program to end: raises KeyboardInterrupt, and remembers it.

    Python swallows what is raised in a finalizer or in a callback of an import ("Exception ignored in"), where a signal
    may find the program; a loop that runs until the end therefore looks at `requested`, too.

    requested: whether a signal has come. Not an event: a thread that waits for an event holds the event's lock, for
    which a handler in the same thread would wait.
    """

    def __init__(self) -> None:
        self.requested = False

    def __call__(self, _number: int, _frame: FrameType | None) -> None:
        self.requested = True
        raise KeyboardInterrupt
