"""Precompilation of kernels: starts the process `app.workers.precompile`, once for each state of the kernels'
sources."""

from __future__ import annotations

import subprocess
import threading
from pathlib import Path

import structlog

from app.process import launcher
from app.process.kernel_cache import cache_folder

log = structlog.get_logger()


def start() -> subprocess.Popen[bytes] | None:
    """Start the precompilation, unless it has been done before. The process ends with this one; where it cannot be
    started, kernels are compiled when a session needs them."""
    if mark().exists():
        return None
    try:
        process = launcher.start("app.workers.precompile", niceness=19, stdin=subprocess.PIPE)
    except OSError as error:
        log.warning("no precompilation", reason=error.strerror)
        return None
    # nobody waits for its result; unwaited it would stay a zombie as long as the server runs
    threading.Thread(target=process.wait, name="precompilation", daemon=True).start()
    return process


def mark() -> Path:
    """File that exists when everything has been compiled."""
    return cache_folder() / "complete"
