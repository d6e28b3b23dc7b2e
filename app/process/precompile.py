"""Precompilation of kernels: starts the process `app.workers.precompile`, once for each state of the kernels'
sources."""

from __future__ import annotations

import subprocess
from pathlib import Path

from app.process import launcher
from app.process.kernel_cache import cache_folder


def start() -> subprocess.Popen[bytes] | None:
    """Start the precompilation, unless it has been done before. The process ends with this one."""
    if mark().exists():
        return None
    return launcher.start("app.workers.precompile", stdin=subprocess.PIPE)


def mark() -> Path:
    """File that exists when everything has been compiled."""
    return cache_folder() / "complete"
