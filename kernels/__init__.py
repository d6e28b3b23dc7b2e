"""What the compiled functions of controllers and environments share.

A kernel takes its data as records, named tuples laid out in one piece of memory (`kernels.records`): their shapes are
known when it is compiled, so that loops unroll, and nothing is allocated while it runs. Results go to the last
arguments.
"""

import hashlib
from typing import Any

from numba import jit, njit, types

# contracting a b + c to one rounding is the only liberty that the compiler may take
kernel = njit(cache=True, error_model="numpy", fastmath={"contract"})
# a part is called by kernels only, and compiles faster for that
part = jit(
    nopython=True,
    no_cpython_wrapper=True,  # pyright: ignore[reportCallIssue]
    no_cfunc_wrapper=True,
    error_model="numpy",
    fastmath={"contract"},
)


def _array_symbol(array: types.NestedArray) -> tuple[str, list[Any]]:
    return "NestedArray", [array.dtype, *array.shape]


def _record_symbol(record: types.Record) -> tuple[str, list[Any]]:
    return "Record", [hashlib.sha256(record.name.encode()).hexdigest()[:16]]


# numba names a compiled function after the types of its arguments, but of an array within a record it leaves out the
# shape, and of a record it takes a number that counts types in the order in which a process meets them: kernels for
# arms with 6 and with 7 joints, compiled by two processes and read from the cache into a third, called each other's
types.NestedArray.mangling_args = property(_array_symbol)  # pyright: ignore[reportAttributeAccessIssue]
types.Record.mangling_args = property(_record_symbol)  # pyright: ignore[reportAttributeAccessIssue]
