"""The end of a program that must not take longer than it takes."""

from __future__ import annotations

import os
import threading

ENDING = 1.8  # s


def end_within(seconds: float = ENDING) -> None:
    """End the process then, if it has not ended by itself: nothing that hangs may keep it."""
    timer = threading.Timer(seconds, os._exit, (0,))
    timer.daemon = True
    timer.start()
