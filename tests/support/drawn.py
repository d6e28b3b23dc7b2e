"""A dashboard that draws in a thread of its own, as `vsmrc serve` has it draw."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from app.dashboard.page import Dashboard
from drivers.waiting import PATIENCE


@contextmanager
def drawn(dashboard: Dashboard) -> Iterator[Dashboard]:
    """Meanwhile; then it is closed, and its thread has ended. Whoever is attached is the caller's."""
    drawing = threading.Thread(target=dashboard.run_forever, daemon=True)
    drawing.start()
    try:
        yield dashboard
    finally:
        dashboard.close()
        drawing.join(PATIENCE)  # for the frame that is just being drawn
    assert not drawing.is_alive()
