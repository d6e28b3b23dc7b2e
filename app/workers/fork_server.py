"""Fork server's process: `python -m app.workers.fork_server FD`, started by `app.process.fork_server`.

The first message is a scenario (TOML). Each later one brings a file, for which this process forks a session's process;
that one sends its number back. This process has one thread only, since a fork keeps no other.
"""

from __future__ import annotations

import contextlib
import errno
import gc
import os
import socket
import sys
import time
from collections.abc import Iterator
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

from app.process import launcher, precompile
from app.process.fork_server import ForkedProcess
from app.process.free_memory import give_back
from app.process.log import configure_as_parent
from app.process.priority import lower_priority
from app.scenario.data import from_toml, shipped
from app.scenario.errors import ScenarioError
from app.session.preview_client import NICENESS, Previewer
from app.simulation.warm_up import warm_up
from app.workers import preview, session

LONGEST = 2**20  # bytes of a message
SESSION, PREVIEW = "vsmrc-session", "vsmrc-preview"  # names as `ps` and `top` show them


def main() -> None:
    """Load what every session needs, then fork until the other end closes."""
    configure_as_parent()
    parent = os.getppid()
    with socket.socket(fileno=int(sys.argv[1])) as control:
        scenario = control.recv(LONGEST).decode()
        if precompile.mark().exists():  # otherwise the first session compiles, and shows its progress
            with contextlib.suppress(ScenarioError):  # the session's page will show it
                begun = from_toml(scenario)
                loop = warm_up(begun)
                if begun == shipped().get(begun.name):  # kernels of other scenarios' previews may not be compiled yet
                    preview.load_for(loop)
        give_back()
        gc.freeze()  # otherwise the first collection in a fork would copy all shared memory
        while files := socket.recv_fds(control, LONGEST, 1)[1]:
            with answered_by_its_number(control):
                if (between := os.fork()) == 0:
                    _fork_again(control, files[0], parent)
                os.waitpid(between, 0)
            os.close(files[0])


@contextlib.contextmanager
def answered_by_its_number(control: socket.socket) -> Iterator[None]:
    """Context whose OSError is the answer to the other end, which waits for one: its number, negative."""
    try:
        yield
    except OSError as error:
        control.send(str(-(error.errno or errno.EIO)).encode())


def _fork_again(control: socket.socket, file: int, parent: int) -> None:
    """Fork the session's process, and end, so that the system makes it a child of this process's grandparent, see
    `app.process.fork_server`."""
    between = os.getpid()
    try:
        with answered_by_its_number(control):
            if os.fork() == 0:
                while os.getppid() == between:
                    time.sleep(1e-3)
                if os.getppid() == parent:
                    _begin(control, file, parent)
    finally:
        os._exit(0)


def _begin(control: socket.socket, file: int, parent: int) -> None:
    """Make this forked process a session's, send its number, and serve the session."""
    _become(SESSION, parent)
    control.send(str(os.getpid()).encode())
    control.close()  # nor may a fork have it: whether the fork server lives, shows in whether its end is open
    session.limit_resources()
    session.run(file, Previewer(_forked_preview(file)))


def _forked_preview(session_file: int) -> tuple[ForkedProcess, Connection]:
    """Process that answers the session's what-if questions, and the connection to it."""
    parent, (ours, theirs) = os.getpid(), Pipe()
    if (process := os.fork()) == 0:
        try:
            _become(PREVIEW, parent)
            os.close(session_file)
            ours.close()
            lower_priority(NICENESS)
            preview.run(theirs)
        finally:
            os._exit(0)
    theirs.close()
    return ForkedProcess(process), ours


def _become(name: str, parent: int) -> None:
    """Give this forked process a name and a process group of its own, and let it end with its parent."""
    os.setpgid(0, 0)
    launcher.end_when_killed(parent)
    Path("/proc/self/comm").write_text(name)


if __name__ == "__main__":
    main()
