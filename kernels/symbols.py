"""Compiler and types of numba, with names that are unique within a cache, and a cache that several processes fill."""

import fcntl
import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
from numba import from_dtype, jit, types
from numba.core.caching import IndexDataCacheFile

__all__ = ["jit", "type_of"]


def type_of(argument: np.ndarray | float) -> types.Type:
    """numba's type of an argument of a kernel."""
    if isinstance(argument, np.ndarray):
        layout = "C" if argument.flags.c_contiguous else "F" if argument.flags.f_contiguous else "A"
        return _array_type(argument.dtype, argument.ndim, layout)
    return types.float64


@cache
def _array_type(dtype: np.dtype, ndim: int, layout: str) -> types.Type:
    return types.Array(from_dtype(dtype), ndim, layout)


def _array_symbol(array: types.NestedArray) -> tuple[str, list[Any]]:
    return "NestedArray", [array.dtype, *array.shape]


def _record_symbol(record: types.Record) -> tuple[str, list[Any]]:
    return "Record", [hashlib.sha256(record.name.encode()).hexdigest()[:16]]


# numba names a compiled function after the types of its arguments, but of an array within a record it leaves out the
# shape, and of a record it takes a number that counts types in the order in which a process meets them. Without this,
# cached kernels for 6 and 7 joints have the same symbol and are linked to the wrong callees.
types.NestedArray.mangling_args = property(_array_symbol)  # pyright: ignore[reportAttributeAccessIssue]
types.Record.mangling_args = property(_record_symbol)  # pyright: ignore[reportAttributeAccessIssue]


_save, _load = IndexDataCacheFile.save, IndexDataCacheFile.load


@contextmanager
def _locked(file: Any, how: int) -> Iterator[None]:
    with open(f"{file._index_path}.lock", "ab") as lock:
        fcntl.flock(lock, how)
        yield


def _save_alone(file: Any, key: object, data: object) -> None:
    with _locked(file, fcntl.LOCK_EX):
        _save(file, key, data)


def _load_whole(file: Any, key: object) -> object:
    with _locked(file, fcntl.LOCK_SH):
        return _load(file, key)


# numba reads a function's index, adds an entry, and writes it back: of two processes that compile it for two arms at
# the same time, one entry was lost, and the code for one arm could be found under the types of the other
IndexDataCacheFile.save = _save_alone  # pyright: ignore[reportAttributeAccessIssue]
IndexDataCacheFile.load = _load_whole  # pyright: ignore[reportAttributeAccessIssue]
