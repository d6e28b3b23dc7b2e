"""Compilation of kernels, the functions that numba compiles for controllers and environments.

A kernel takes its data as records, named tuples laid out in one piece of memory (`kernels.records`): their shapes are
known when it is compiled, so that loops unroll. It makes no new arrays: results go to its last arguments, and numba
counts no references.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import cached_property, update_wrapper
from importlib import import_module
from typing import Any

import numpy as np

# the compiler may contract a b + c to one rounding, and change nothing else of the arithmetic
ARITHMETIC: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}
# counting the references to arrays that nobody frees took a fifth of a period
NO_NEW_ARRAYS = {"_nrt": False}


class Kernel:
    """A function that is compiled at its first call, or when another kernel that calls it is compiled.

    numba is not imported before that: a program that only reads the name of a surface does not wait for numba.
    """

    def __init__(self, function: Callable[..., Any], **options: Any) -> None:
        self._options = options
        update_wrapper(self, _named(function))
        self.py_func = function

    @cached_property
    def dispatcher(self) -> Any:
        """numba's dispatcher of the function."""
        return self._jit(nopython=True, **ARITHMETIC, **NO_NEW_ARRAYS | self._options)(self.py_func)

    @property
    def _jit(self) -> Callable[..., Any]:
        from kernels.symbols import jit

        return jit

    @property
    def _numba_type_(self) -> Any:  # where numba looks for what another kernel calls
        from numba import types

        return types.Dispatcher(self.dispatcher)

    def check_indices(self) -> None:
        """Have the function compiled with checks: an index beyond an array raises IndexError, and each exception of an
        inline kernel has its line. To be called before the function is compiled."""
        self._options["boundscheck"] = True

    def __call__(self, *arguments: Any) -> Any:
        return self.dispatcher(*arguments)


class LinkedKernel(Kernel):
    """A kernel that only kernels call. It has no machine code of its own, and compiles faster because of that."""

    @property
    def _jit(self) -> Callable[..., Any]:
        from kernels.linking import jit_to_link

        return jit_to_link


def kernel(function: Callable[..., Any]) -> Any:
    """Kernel that is kept in the cache, for later processes."""
    return Kernel(function, cache=True)


def without_lock(function: Callable[..., Any]) -> Any:
    """Kernel that is kept in the cache and lets other threads of the interpreter run meanwhile."""
    return Kernel(function, cache=True, nogil=True)


def not_kept(function: Callable[..., Any]) -> Any:
    """Kernel that is compiled anew in each process."""
    return Kernel(function)


def inline(function: Callable[..., Any]) -> Any:
    """Kernel that is called by kernels only, and compiles faster because of that."""
    return LinkedKernel(function)


def allocating(function: Callable[..., Any]) -> Any:
    """Inline kernel that may make new arrays. It is slower: numba counts the references to each. Whoever calls it for a
    new array has to be such a kernel, too."""
    return LinkedKernel(function, _nrt=True)


def _named(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, renamed: its name also lists the parts in its closure.

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
    """Inline kernel `chosen(number, *arguments)` that calls the kernel of this number with the arguments. It raises
    ValueError for a number without a kernel.
    first: the number that is compared first."""
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
    """Whether a function is a kernel, or one that numba has compiled."""
    if isinstance(function, Kernel):
        return True
    registry = sys.modules.get("numba.core.registry")  # without numba imported, no function is one of numba's
    return registry is not None and isinstance(function, registry.CPUDispatcher)


def compiled_for(kernel: Kernel, *arguments: np.ndarray | float) -> Callable[..., Any]:
    """The kernel compiled for arguments of these types, to be called again and again with arguments of exactly these
    types.

    A call takes 0.1 us less per argument than one of the kernel itself, which looks at the types in every call.
    """
    from kernels.symbols import type_of

    types = tuple(type_of(argument) for argument in arguments)
    known = kernel.dispatcher.overloads.get(types)  # numba's own way takes 0.1 ms, and a run resolves sixty kernels
    return kernel.dispatcher.compile(types) if known is None else known.entry_point


def address_for(kernel: Kernel, *arguments: np.ndarray | float) -> int:
    """Address in this process of the kernel compiled for arguments of these types, for `kernels.pointers.ask`."""
    from kernels.symbols import type_of

    return address_of(kernel, tuple(type_of(argument) for argument in arguments))


def address_of(kernel: Kernel, types: tuple[Any, ...]) -> int:
    """Address as `address_for` gives it, for arguments of these types of numba."""
    if types not in kernel.dispatcher.overloads:  # as in `compiled_for`
        kernel.dispatcher.compile(types)
    found = kernel.dispatcher.overloads[types]
    return found.library.get_pointer_to_function(found.fndesc.llvm_func_name)


class Elsewhere:
    """A kernel of a module that imports numba; the module is imported only when another kernel that calls it is
    compiled."""

    def __init__(self, module: str, name: str) -> None:
        self._module, self._name = module, name

    @property
    def _numba_type_(self) -> Any:
        return getattr(import_module(self._module), self._name)._numba_type_
