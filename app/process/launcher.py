"""Subprocess launcher: starts processes that run modules of this program.

Its command is `python -m app.process.launcher PARENT NICENESS MODULE ARGUMENTS`.
"""

from __future__ import annotations

import ctypes
import os
import resource
import runpy
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Protocol

from app.process.priority import lower_priority

_PR_SET_PDEATHSIG = 1
LEFT_SEMAPHORES = "ignore::UserWarning:multiprocessing.resource_tracker"


class ChildProcess(Protocol):
    """Interface of a child process, as `subprocess.Popen` has it."""

    pid: int

    def poll(self) -> int | None: ...
    def terminate(self) -> None: ...
    def kill(self) -> None: ...
    def wait(self, timeout: float | None = None) -> int: ...


def start(
    module: str, *arguments: str, niceness: int, stdin: int, pass_fds: tuple[int, ...] = ()
) -> subprocess.Popen[bytes]:
    """Start `python -m module arguments` in a process group of its own, so that Ctrl-C reaches only the dashboard.
    Raises OSError.

    The process stays in this session of the system: Linux gives every session the same share of the processor, however
    nice its processes are (autogroup). On Linux the process is killed when the thread that calls this function ends.

    niceness: how far the process steps back behind the running loop, see `lower_priority`, from its first moment on:
    loading the program takes a second of a core. stdin: as in `subprocess`; pass_fds: files that the process inherits.
    """
    # -P and the path: this program, whatever lies in the user's folder
    path = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    # a pool that is ended leaves its semaphores to Python's resource tracker, whose warning is no news for the terminal
    warnings = ",".join(filter(None, (os.environ.get("PYTHONWARNINGS"), LEFT_SEMAPHORES)))
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "app.process.launcher", str(os.getpid()), str(niceness), module, *arguments],
        stdin=stdin,
        pass_fds=pass_fds,
        env=os.environ | {"PYTHONPATH": path, "PYTHONWARNINGS": warnings},
        process_group=0,
    )


def end_with_parent() -> None:
    """End this process, from now on, with the one that started it and whose pipe is its standard input."""

    def wait() -> None:
        os.read(sys.stdin.fileno(), 1)  # returns when the other end is gone
        os._exit(0)

    threading.Thread(target=wait, name="parent", daemon=True).start()


def end_when_killed(parent: int) -> None:
    """End this process, on Linux, when its parent ends, also where this process is stopped and notices nothing."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent:  # it has ended before
            os._exit(1)


def main() -> None:
    """Run the module, which ends with its parent."""
    _, parent, niceness, module, *arguments = sys.argv
    end_when_killed(int(parent))
    lower_priority(int(niceness))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # a core would have all links and tokens in it
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
