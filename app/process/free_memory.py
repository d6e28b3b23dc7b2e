"""Free memory of this process: what the allocator keeps of it is given back to the system."""

from __future__ import annotations

import ctypes
import gc


def give_back() -> None:
    """Collect garbage and give freed memory back; it takes some ten ms. The C library keeps what lies below memory in
    use, which after the start, with its many short-lived arrays, is a tenth of it; one that knows no other way keeps
    it."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc's
    if trim is not None:
        trim(0)
