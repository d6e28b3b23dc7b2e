"""What the compiled functions of controllers and environments share.

A kernel takes its data as records, named tuples laid out in one piece of memory (`kernels.records`): their shapes are
known when it is compiled, so that loops unroll, and nothing is allocated while it runs. Results go to the last
arguments.
"""

import hashlib
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numba import from_dtype, jit, njit, types
from numba.core.registry import CPUDispatcher

# contracting a b + c to one rounding is the only liberty that the compiler may take
_ARITHMETIC: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}


def kernel(function: Callable[..., Any]) -> Any:
    """A compiled function, kept in the cache of the next processes."""
    return njit(cache=True, **_ARITHMETIC)(_named(function))


def not_kept(function: Callable[..., Any]) -> Any:
    """A kernel that is compiled anew in each process."""
    return njit(**_ARITHMETIC)(_named(function))


def inline(function: Callable[..., Any]) -> Any:
    """A kernel that is called by kernels only, and compiles faster for that."""
    own_way = {"nopython": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return jit(**own_way, **_ARITHMETIC)(_named(function))


def _named(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, with what it is made of in its name.

    Compiled code is linked by the function's name, the types of its arguments and a number that begins anew in each
    process. Two functions that one line of code makes of different parts would have one name; read from the cache of
    two processes, the second would be taken for the first.
    """
    parts = [cell.cell_contents for cell in function.__closure__ or ()]
    if parts:
        function.__qualname__ += f" of {', '.join(_name(part) for part in parts)}"
    return function


def _name(part: Any) -> str:
    return f"{part.__module__}.{part.__qualname__}" if callable(part) else repr(part)


def choice(kernels: Sequence[Callable[..., Any]], first: int = 0) -> Callable[..., Any]:
    """An inline kernel `chosen(number, *arguments)` that calls the one of this number with the arguments; `first`: the
    number that is looked at first. It raises ValueError where there is none of that number."""
    here = kernels[first]
    if first == len(kernels) - 1:

        @inline
        def last(number, *arguments):
            if number != first:
                raise ValueError("there is no kernel of this number")
            return here(*arguments)

        return last
    others = choice(kernels, first + 1)

    @inline
    def chosen(number, *arguments):
        if number == first:
            return here(*arguments)
        return others(number, *arguments)

    return chosen


def compiled(function: Callable[..., Any]) -> bool:
    """Whether a function is a kernel, inline or not."""
    return isinstance(function, CPUDispatcher)


def compiled_for(kernel: Any, *arguments: np.ndarray | float) -> Callable[..., Any]:
    """The kernel compiled for arguments of these types, to be called again and again with arguments of just these.

    It takes 0.1 us less per argument than the kernel itself, which looks at their types in every call.
    """
    return kernel.compile(tuple(_type_of(argument) for argument in arguments))


def _type_of(argument: np.ndarray | float) -> types.Type:
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
# shape, and of a record it takes a number that counts types in the order in which a process meets them: kernels for
# arms with 6 and with 7 joints, compiled by two processes and read from the cache into a third, called each other's
types.NestedArray.mangling_args = property(_array_symbol)  # pyright: ignore[reportAttributeAccessIssue]
types.Record.mangling_args = property(_record_symbol)  # pyright: ignore[reportAttributeAccessIssue]
