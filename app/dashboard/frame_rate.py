"""Frame rate of the scene; apart from the page, so that who only checks it loads nothing."""

from __future__ import annotations

FPS = 30.0  # scene
SLOWEST_FPS, FASTEST_FPS = 1.0, 60.0


def check_fps(fps: float) -> None:
    """Raise ValueError for pictures per second outside of the allowed range."""
    if not SLOWEST_FPS <= fps <= FASTEST_FPS:
        raise ValueError(f"fps: {fps:g}; allowed: {SLOWEST_FPS:g} to {FASTEST_FPS:g}")
