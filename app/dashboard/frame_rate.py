"""Frame rate of the scene; not in `page.py`, so that the command line can check it without loading viser."""

from __future__ import annotations

FPS = 30.0  # scene
SLOWEST_FPS, FASTEST_FPS = 1.0, 60.0


def check_fps(fps: float) -> None:
    """Raise ValueError for a frame rate, pictures per second, outside of the allowed range."""
    if not SLOWEST_FPS <= fps <= FASTEST_FPS:
        raise ValueError(f"fps: {fps:g}; allowed: {SLOWEST_FPS:g} to {FASTEST_FPS:g}")
