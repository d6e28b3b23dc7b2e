"""Deadline for the end of a program, which must not take longer."""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import sys
import threading
from typing import NoReturn

ENDING = 1.8  # s
FAILED = 1  # exit status after a failure, also where what was printed is lost


def end_within(status: int = 0) -> None:
    """End the process with this status after `ENDING` if it has not ended by itself, whatever hangs."""
    # while the interpreter is being taken down the timer does not fire any more: see `end`
    timer = threading.Timer(ENDING, os._exit, (status,))
    timer.daemon = True
    timer.start()


def end(status: int) -> NoReturn:
    """End the process now, after the functions that are registered with `atexit`.

    To be called when all threads and processes have ended. The system frees the memory: the interpreter took three
    seconds on a busy machine to free itself and its libraries.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    atexit._run_exitfuncs()
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except BrokenPipeError:
        pass  # the reader of the pipe has closed it, as `head` does
    except OSError as error:
        status = status or FAILED
        with contextlib.suppress(OSError):
            os.write(2, f"vsmrc: standard output cannot be written: {error.strerror}\n".encode())
    os._exit(status)
