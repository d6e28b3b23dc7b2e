"""The `vsmrc` command in a process of its own, and what a command has left."""

from __future__ import annotations

import subprocess
import sys
from typing import NamedTuple


def vsmrc(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own."""
    return subprocess.run([sys.executable, "-m", "app", *arguments], capture_output=True, text=True, timeout=600)


class Done(NamedTuple):
    """Result of a command within this process: exit status, and what it printed."""

    returncode: int
    stdout: str
    stderr: str
