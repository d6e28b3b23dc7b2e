"""Waiting for a condition, for tests and drivers."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

PATIENCE = 180.0  # s, for a busy machine

T = TypeVar("T")


def until(condition: Callable[[], T | None], what: object = "") -> T:
    """Result of the condition, as soon as it is true. Fails after `PATIENCE`. what: message of the failure, or a
    function that returns it."""
    deadline = time.monotonic() + PATIENCE
    while not (met := condition()):
        assert time.monotonic() < deadline, what() if callable(what) else what
        time.sleep(0.01)
    return met
