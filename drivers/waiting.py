"""Wait for a condition."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

PATIENCE = 180.0  # s, for a machine that has other things to do

T = TypeVar("T")


def until(condition: Callable[[], T | None], what: object = "") -> T:
    """Result of the condition, as soon as it is true; `what`, or its result, is the message if it never is."""
    deadline = time.monotonic() + PATIENCE
    while not (met := condition()):
        assert time.monotonic() < deadline, what() if callable(what) else what
        time.sleep(0.01)
    return met
