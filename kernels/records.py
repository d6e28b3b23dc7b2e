"""Records: named tuples laid out in one piece of memory, in which a kernel reads and writes by the same names.

Handing one record to a compiled function costs about 0.06 us; a named tuple of sixty arrays costs 10 us.
"""

from __future__ import annotations

from functools import cache, cached_property
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

T = TypeVar("T", bound=NamedTuple)
Layout = tuple[tuple[Any, ...], ...]
NUMBERS = {kind: np.dtype(kind) for kind in (float, int, bool, np.float64, np.int64, np.bool_)}


class Record(Generic[T]):
    """A named tuple of arrays, numbers and further named tuples in one piece of memory.

    data: a structured array (1,) for kernels, where `data[0].name` is a field.
    """

    def __init__(self, value: T) -> None:
        self._template = value
        self.data = np.zeros(1, _dtype(_layout(value)))
        self.data[0] = value

    @classmethod
    def zeros(cls, kind: Any, n: int) -> Record[Any]:
        """Record of `kind.zeros(n)`: a copy of one that is built once, which takes a hundredth of the time."""
        return _zeros(kind, n).copy()

    @cached_property
    def fields(self) -> Fields:
        """Fields of the record as attributes, to be read and written."""
        return Fields(self.data)

    @cached_property
    def read_only(self) -> Fields:
        """Fields of the record as attributes, to be read: numpy refuses to write there."""
        data = self.data.view()
        data.flags.writeable = False
        return Fields(data)

    @property
    def views(self) -> T:
        """The same, with the types of the named tuple; that itself would take a hundred times as long, see `read`."""
        return self.fields  # pyright: ignore[reportReturnType]

    def read(self) -> T:
        """Named tuple with the present numbers; its arrays are views of the record's memory."""
        return _read(self.data, self._template)

    def part(self, name: str) -> Any:
        """Inner named tuple of this name, with the present numbers; its arrays are views of the record's memory."""
        return _read(self.data[name], getattr(self._template, name))

    def write(self, name: str, value: NamedTuple) -> None:
        """Write other values, of the same shapes, into the inner named tuple of this name."""
        self.data[name][0] = value

    def take(self, other: Record[T]) -> None:
        """Take over the numbers of a record of the same kind, in one piece: numpy would go field by field."""
        self._bytes[:] = other._bytes

    def __reduce__(self) -> tuple[type[Record[T]], tuple[T]]:
        return Record, (self.read(),)  # numba needs the dtype that all records of a layout share

    def copy(self) -> Record[T]:
        """Copy of the record, in memory of its own."""
        twin = object.__new__(Record)
        twin._template = self._template
        # in one piece, not field by field; to see bytes as records takes numpy five times as long
        twin.data = np.frombuffer(bytearray(self.data.tobytes()), self.data.dtype)
        return twin

    @cached_property
    def _bytes(self) -> np.ndarray:
        return self.data.view(np.uint8)


@cache
def _zeros(kind: Any, n: int) -> Record[Any]:
    return Record(kind.zeros(n))


class Fields:
    """Fields of a record as attributes in the interpreter, as a kernel has them: arrays are views of the record's
    memory, numbers are read and written there."""

    def __init__(self, data: np.ndarray) -> None:
        vars(self)["_data"] = data

    def __getattr__(self, name: str) -> Any:  # called for numbers, and once for each array or record
        data = vars(self)["_data"]
        if name not in data.dtype.names:
            raise AttributeError(f"no field {name!r}; there are {', '.join(data.dtype.names)}")
        part = data[name]
        if part.dtype.names is None and part.ndim == 1:
            return part[0].item()
        found = vars(self)[name] = part[0] if part.dtype.names is None else Fields(part)
        return found

    def __setattr__(self, name: str, value: Any) -> None:
        data = vars(self)["_data"]
        if name not in data.dtype.names:
            raise AttributeError(f"no field {name!r}; there are {', '.join(data.dtype.names)}")
        data[name][0] = value


def _layout(value: NamedTuple) -> Layout:
    """Layout of a named tuple's memory, in a form that can be compared; `_dtype` makes the dtype."""
    layout: list[tuple[Any, ...]] = []
    for name, part in zip(value._fields, value, strict=True):
        if isinstance(part, np.ndarray):
            layout.append((name, part.dtype, part.shape))
        elif isinstance(part, tuple):
            layout.append((name, _layout(part)))  # pyright: ignore[reportArgumentType]
        else:
            layout.append((name, NUMBERS.get(type(part)) or np.asarray(part).dtype, ()))
    return tuple(layout)


@cache  # numba looks dtypes up by identity: equal layouts must share one
def _dtype(layout: Layout) -> np.dtype:
    fields = [(name, _dtype(rest[0])) if len(rest) == 1 else (name, *rest) for name, *rest in layout]
    return np.dtype(fields, align=True)


def _read(data: np.ndarray, template: Any) -> Any:
    parts = []
    for name, part in zip(template._fields, template, strict=True):
        if isinstance(part, tuple):
            parts.append(_read(data[name], part))
        elif isinstance(part, np.ndarray):
            parts.append(data[name][0])
        else:
            parts.append(data[name][0].item())
    return type(template)(*parts)
