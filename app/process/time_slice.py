"""Time slice of a thread: how long it may keep a processor while others wait. A thread that asks for a short one gets
its turn sooner after it wakes, and no more processor time than before."""

from __future__ import annotations

import ctypes
import os
import platform
import sys

# numbers of the system calls sched_getattr and sched_setattr, which glibc has wrapped only since 2.41
CALLS = {"x86_64": (315, 314), "aarch64": (275, 274)}


class _Attributes(ctypes.Structure):
    """Attributes of a thread's scheduling, `struct sched_attr` of Linux, with its field `sched_runtime` in ns."""

    _fields_ = (
        ("size", ctypes.c_uint32),
        ("policy", ctypes.c_uint32),
        ("flags", ctypes.c_uint64),
        ("nice", ctypes.c_int32),
        ("priority", ctypes.c_uint32),
        ("runtime", ctypes.c_uint64),
        ("deadline", ctypes.c_uint64),
        ("period", ctypes.c_uint64),
    )


def shorten_time_slice(seconds: float) -> None:
    """Ask for a time slice of so many seconds (0.0001 to 0.1) for the calling thread. Linux follows that from 6.12 on;
    an earlier one, and other systems, change nothing. Raises OSError where Linux does not allow the question."""
    attributes = _read()
    if attributes is not None:
        attributes.runtime = round(1e9 * seconds)
        _call(CALLS[platform.machine()][1], attributes, 0)


def time_slice() -> float | None:
    """Time slice of the calling thread, s, 0 before Linux 6.12; None on other systems. Raises OSError."""
    attributes = _read()
    return None if attributes is None else 1e-9 * attributes.runtime


def _read() -> _Attributes | None:
    if sys.platform != "linux" or platform.machine() not in CALLS:
        return None
    attributes = _Attributes()
    _call(CALLS[platform.machine()][0], attributes, ctypes.sizeof(attributes), 0)
    return attributes


def _call(number: int, attributes: _Attributes, *further: int) -> None:
    """Make a system call about the calling thread. Raises OSError."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.syscall(ctypes.c_long(number), 0, ctypes.byref(attributes), *further) != 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
