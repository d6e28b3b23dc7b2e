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
UNWRITTEN = 1  # exit status where what was printed is lost


def end_within(seconds: float = ENDING) -> None:
    """End the process after `seconds` if it has not ended by itself, whatever hangs."""
    # while the interpreter is being taken down the timer does not fire any more: see `end`
    timer = threading.Timer(seconds, os._exit, (0,))
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
        status = status or UNWRITTEN
        with contextlib.suppress(OSError):
            os.write(2, f"vsmrc: standard output cannot be written: {error.strerror}\n".encode())
    os._exit(status)
