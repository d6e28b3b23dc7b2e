"""Free memory of this process, given back to the system by the allocator."""

from __future__ import annotations

import ctypes
import gc


def give_back() -> None:
    """Collect garbage and give free memory back to the system, which takes some ten ms.

    By itself the C library keeps free memory that lies below memory in use: a tenth of all after the start, with its
    many short-lived arrays. A C library without `malloc_trim` keeps it.
    """
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc's
    if trim is not None:
        trim(0)
