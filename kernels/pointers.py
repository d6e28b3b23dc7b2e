"""Calls of functions by their address in this process: kernels that were compiled without these functions can call
them, and need not be compiled anew with them."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable
from typing import Any, NamedTuple

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.numpy_support import carray
from numba.np.unsafe import ndarray

from kernels import Kernel, address_of, inline

Shape = tuple[int, ...]
_PLACES = 4  # addresses of data that a call passes: of the parameters and of three arrays


def _generate_numbers_at(_typing, _place):
    """Signature and instructions that make a pointer to numbers from their address, as numba's `intrinsic` takes
    them."""
    signature = types.CPointer(types.float64)(types.uintp)

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return signature, generate


_numbers_at: Any = intrinsic(_generate_numbers_at)
_fixed: Any = ndarray.to_fixed_tuple


def _generate_ask(returns: types.Type) -> Any:
    """Function that calls the kernel at an address, which returns a value of this type; its exceptions go on to the
    caller."""

    def generate_ask(_typing, address, arguments):
        kinds = tuple(arguments)

        def generate(context, builder, _signature, given):
            convention = context.call_conv
            kind = convention.get_function_type(returns, kinds)
            kernel = builder.inttoptr(given[0], kind.as_pointer())
            values = [builder.extract_value(given[1], i) for i in range(len(kinds))]
            status, result = convention.call_function(builder, kernel, returns, kinds, values)
            with cgutils.if_unlikely(builder, status.is_error):
                convention.return_status_propagate(builder, status)
            return context.get_dummy_value() if returns == types.none else result

        return returns(address, arguments), generate

    return intrinsic(generate_ask)


_ask, _ask_integer, _ask_number = (_generate_ask(kind) for kind in (types.none, types.int64, types.float64))


@inline
def ask(address, arguments):
    """Call the kernel at an address, which returns nothing, with a tuple of arguments of exactly the types for which it
    was compiled (`kernels.address_for`)."""
    _ask(address, arguments)


@inline
def ask_integer(address, arguments):
    """Call the kernel at an address, which returns an integer; see `ask`."""
    return _ask_integer(address, arguments)


@inline
def ask_number(address, arguments):
    """Call the kernel at an address, which returns a number; see `ask`."""
    return _ask_number(address, arguments)


@inline
def call(address, t, parameters, a, b, c):
    """Call the function at an address at time t (s), with its parameters and three arrays of the shapes for which it
    was compiled; see `ask`."""
    ask(address, (float(t), parameters.ctypes.data, a.ctypes.data, b.ctypes.data, c.ctypes.data))


class CompiledAlone(NamedTuple):
    """Function compiled for `call`. kernel: keeps its code; address: of the code, which holds as long as the kernel
    lives."""

    kernel: Kernel
    address: int


def compiled_alone(
    function: Callable[..., None], names: tuple[str, ...], shapes: tuple[Shape, Shape, Shape]
) -> CompiledAlone:
    """Compiled `function(t, parameters, a, b, c)` for `call`, with parameters of these names and arrays of these
    shapes. Raises numba's errors."""
    names = names or ("none",)  # an empty tuple cannot be compiled
    count, first, second, third = len(names), *shapes
    Parameters = namedtuple("Parameters", names)

    def at_places(t, parameters, a, b, c):
        numbers = _fixed(carray(_numbers_at(parameters), (count,)), count)
        function(
            t,
            Parameters(*numbers),
            carray(_numbers_at(a), first),
            carray(_numbers_at(b), second),
            carray(_numbers_at(c), third),
        )

    kernel = Kernel(at_places, _nrt=True)
    return CompiledAlone(kernel, address_of(kernel, (types.float64, *(types.uintp,) * _PLACES)))
