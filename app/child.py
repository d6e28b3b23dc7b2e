"""Processes beside this one, which run modules of this very program."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path


def start(module: str, *arguments: str, stdin: int, pass_fds: tuple[int, ...] = ()) -> subprocess.Popen[bytes]:
    """`python -m module arguments` in a session of its own: Ctrl-C is the dashboard's business. Raises OSError.

    stdin: as `subprocess` has it; pass_fds: files that it inherits.
    """
    # -P and the path: this program, whatever lies in the user's folder
    path = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    return subprocess.Popen(
        [sys.executable, "-P", "-m", module, *arguments],
        stdin=stdin,
        pass_fds=pass_fds,
        env=os.environ | {"PYTHONPATH": path},
        start_new_session=True,
    )


def end_with_parent() -> None:
    """From now on, in a process whose standard input is a pipe from the one that began it."""

    def wait() -> None:
        os.read(sys.stdin.fileno(), 1)  # returns when the other end is gone
        os._exit(0)

    threading.Thread(target=wait, name="parent", daemon=True).start()
