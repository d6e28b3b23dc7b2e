"""Functions of a user's own, compiled separately, that the program's kernels call."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kernels import Elsewhere, kernel
from kernels.records import Record

MOST_PARAMETERS = 16  # parameters
BEYOND = 256  # numbers behind an array, which nothing may write
call: Any = Elsewhere("kernels.pointers", "call")
Shapes = tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]


class OwnFunction(NamedTuple):
    """A function in the form for kernels.
    address: in this process.
    digest: of its source, since an address means nothing in the next process.
    parameters: (MOST_PARAMETERS,)."""

    address: np.uint64
    digest: np.uint64
    parameters: np.ndarray


class OwnFunctionError(Exception):
    """Exception of a user's own function where it is tried, its cause; says where that is."""


NO_FUNCTION = OwnFunction(np.uint64(0), np.uint64(0), np.zeros(MOST_PARAMETERS))


def own_function(
    function: Callable[..., None], users: Callable[..., None], parameters: dict[str, float], shapes: Shapes
) -> OwnFunction:
    """Form for kernels of `function(t, parameters, a, b, c)`, which writes into arrays of these shapes. users: the
    user's own function that it calls, whose file is digested. Raises numba's errors."""
    numbers = np.zeros(MOST_PARAMETERS)
    numbers[: len(parameters)] = list(parameters.values())
    kept = _kept(function, tuple(parameters), shapes)
    source = Path(inspect.getfile(inspect.unwrap(users))).read_bytes()
    digest = int.from_bytes(hashlib.sha256(source).digest()[:8], "little")
    return OwnFunction(np.uint64(kept.address), np.uint64(digest), numbers)


@kernel
def _call_alone(own, t, a, b, c):
    call(own[0].address, t, own[0].parameters, a, b, c)


def written_beyond(
    own: OwnFunction, t: float, sizes: tuple[int, int, int], where: str, given: np.ndarray | float = 0.0
) -> list[int | None]:
    """First place behind each of its three arrays, counted from their ends, that a function writes at time t (s), which
    compiled code does not notice in a function of another file that it calls; None where there is none. Raises
    OwnFunctionError where the function fails.
    sizes: of the arrays, which are zero before.
    where: words for this call.
    given: numbers that the first array has instead."""
    arrays = [np.append(np.zeros(size), np.full(BEYOND, np.nan)) for size in sizes]
    arrays[0][: sizes[0]] = given
    try:
        _call_alone(Record(own).data, t, *arrays)
    except Exception as error:  # the function is the user's own, and may raise anything
        raise OwnFunctionError(where) from error
    places = (np.flatnonzero(~np.isnan(array[size:])) for array, size in zip(arrays, sizes, strict=True))
    return [int(found[0]) if len(found) else None for found in places]


@cache  # compiled code must be kept as long as somebody may call it by its address
def _kept(function: Callable[..., None], names: tuple[str, ...], shapes: Shapes) -> Any:
    from kernels.pointers import compiled_alone

    return compiled_alone(function, names, shapes)
