"""Products of small matrices in LLVM's instructions, without loops: each row is one vector of the processor.

The compiler does not make such instructions from loops, because it must assume that a result overlaps a factor in
memory. Here all factors are read before anything is written. Arguments are arrays within records, whose shapes are
known from their types.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kernels import inline

NUMBER, INDEX, PLACE = ir.DoubleType(), ir.IntType(32), ir.IntType(64)
NUMBER_BYTES = 8
CONTRACT = ("contract",)  # a b + c may be rounded once, as `kernels.ARITHMETIC` says
SQUARINGS = 5  # in `spectral_norm`, which is a Schatten norm of order 2^(SQUARINGS + 1)


def _many(kind: Any, count: int) -> Any:
    return ir.VectorType(kind, count)


class _Writer:
    """Writer of LLVM's instructions for one call; `which` is the number of an argument, vectors are rows."""

    def __init__(self, context: Any, builder: Any, signature: Any, arguments: Sequence[Any]) -> None:
        self.builder, self._kinds = builder, signature.args
        self.given = [
            context.make_array(kind)(context, builder, each).data if isinstance(kind, types.Array) else each
            for kind, each in zip(signature.args, arguments, strict=True)
        ]

    def number(self, which: int, place: Any) -> Any:
        """Number of an array at a place, counted along its rows."""
        at = PLACE(place) if isinstance(place, int) else place
        return self.builder.load(self.builder.gep(self.given[which], [at]))

    def row(self, which: int, first: Any) -> Any:
        """Row of a matrix whose first number is at this place."""
        return self.builder.load(self._pointer(which, first, self._kinds[which].shape[1]), align=NUMBER_BYTES)

    def rows(self, which: int) -> list[Any]:
        """Rows of a matrix."""
        count, columns = self._kinds[which].shape
        return [self.row(which, PLACE(i * columns)) for i in range(count)]

    def write(self, which: int, rows: Sequence[Any]) -> None:
        """Write the rows of a matrix, or a vector as its only row."""
        for i, row in enumerate(rows):
            place = self._pointer(which, PLACE(i * row.type.count), row.type.count)
            self.builder.store(row, place, align=NUMBER_BYTES)

    def _pointer(self, which: int, first: Any, count: int) -> Any:
        place = self.builder.gep(self.given[which], [first])
        return self.builder.bitcast(place, _many(NUMBER, count).as_pointer())

    def repeated(self, value: Any, count: int) -> Any:
        """Vector with the same value `count` times."""
        empty = ir.Constant(_many(value.type, count), ir.Undefined)
        first = self.builder.insert_element(empty, value, INDEX(0))
        return self.builder.shuffle_vector(first, empty, ir.Constant(_many(INDEX, count), [0] * count))

    def entry(self, row: Any, j: int) -> Any:
        """Entry j of a row."""
        return self.builder.extract_element(row, INDEX(j))

    def sum_of(self, factors: Sequence[Any], rows: Sequence[Any]) -> Any:
        """Sum of numbers times rows, in this order."""
        total = None
        for factor, row in zip(factors, rows, strict=True):
            part = self.builder.fmul(self.repeated(factor, row.type.count), row, flags=CONTRACT)
            total = part if total is None else self.builder.fadd(total, part, flags=CONTRACT)
        return total

    def product(self, left: Sequence[Any], right: Sequence[Any]) -> list[Any]:
        """Rows of the product of two matrices. Each sum is split in two, which the processor computes side by side."""
        found = []
        for row in left:
            factors, half = [self.entry(row, k) for k in range(len(right))], len(right) // 2
            total = self.sum_of(factors[half:], right[half:])
            found.append(self.builder.fadd(self.sum_of(factors[:half], right[:half]), total) if half else total)
        return found

    def turned(self, rows: Sequence[Any]) -> list[Any]:
        """Columns of a matrix as vectors, from its rows."""
        columns = []
        for j in range(rows[0].type.count):
            column = ir.Constant(_many(NUMBER, len(rows)), ir.Undefined)
            for i, row in enumerate(rows):
                column = self.builder.insert_element(column, self.entry(row, j), INDEX(i))
            columns.append(column)
        return columns

    def trace(self, rows: Sequence[Any]) -> Any:
        """Trace of a matrix, from its rows."""
        total = self.entry(rows[0], 0)
        for i, row in enumerate(rows[1:], start=1):
            total = self.builder.fadd(total, self.entry(row, i))
        return total

    def root(self, number: Any) -> Any:
        """Square root of a number."""
        return self.builder.call(self.builder.module.declare_intrinsic("llvm.sqrt", [NUMBER]), [number])


def _written(returns: types.Type, arguments: tuple[types.Type, ...], write: Callable[[_Writer], Any]) -> Any:
    """Signature of a call with these arguments, and the function that writes its instructions, as numba's `intrinsic`
    takes them."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        result = write(_Writer(context, builder, signature, given))
        return context.get_dummy_value() if result is None else result

    return returns(*arguments), generate


def _write_product(_typing: Any, A: types.NestedArray, B: types.NestedArray, out: types.NestedArray) -> Any:
    def write(writer: _Writer) -> None:
        (count, inner), right = A.shape, writer.rows(1)
        left = [[writer.number(0, i * inner + k) for k in range(inner)] for i in range(count)]
        writer.write(2, [writer.sum_of(factors, right) for factors in left])

    return _written(types.none, (A, B, out), write)


def _write_transposed_product(_typing: Any, A: types.NestedArray, B: types.NestedArray, out: types.NestedArray) -> Any:
    def write(writer: _Writer) -> None:
        (inner, count), right = A.shape, writer.rows(1)
        left = [[writer.number(0, k * count + i) for k in range(inner)] for i in range(count)]
        writer.write(2, [writer.sum_of(factors, right) for factors in left])

    return _written(types.none, (A, B, out), write)


def _write_sum_of_rows(_typing: Any, A: types.NestedArray, x: types.Array, out: types.Array) -> Any:
    def write(writer: _Writer) -> None:
        rows = writer.rows(0)
        writer.write(2, [writer.sum_of([writer.number(1, i) for i in range(len(rows))], rows)])

    return _written(types.none, (A, x, out), write)


def _write_elimination(_typing: Any, A: types.NestedArray, c: types.Integer) -> Any:
    def write(writer: _Writer) -> None:
        builder, number, n = writer.builder, writer.given[1], A.shape[0]
        diagonal = builder.mul(number, number.type(n + 1))
        here = builder.icmp_signed("==", writer.repeated(number, n), ir.Constant(_many(number.type, n), list(range(n))))
        one, none = (ir.Constant(_many(NUMBER, n), [value] * n) for value in (1.0, 0.0))
        pivot = builder.select(here, one, writer.row(0, builder.sub(diagonal, number)))
        scale = builder.fdiv(NUMBER(1.0), writer.number(0, diagonal))
        pivot, others = builder.fmul(pivot, writer.repeated(scale, n)), []
        for i, row in enumerate(writer.rows(0)):
            share = writer.repeated(writer.number(0, builder.add(number, number.type(i * n))), n)
            less = builder.fmul(share, pivot, flags=CONTRACT)
            rest = builder.fsub(builder.select(here, none, row), less, flags=CONTRACT)
            others.append(builder.select(builder.icmp_signed("==", number, number.type(i)), pivot, rest))
        writer.write(0, others)

    return _written(types.none, (A, c), write)


def _write_spectral_norm(_typing: Any, A: types.NestedArray) -> Any:
    def write(writer: _Writer) -> Any:
        builder, rows = writer.builder, writer.rows(0)
        columns = writer.turned(rows)
        powers = writer.product(columns, rows) if len(columns) <= len(rows) else writer.product(rows, columns)
        whole = writer.trace(powers)
        # with a trace of 1 a norm is at least 1/k, which stays a number when it is raised to 32
        share = writer.repeated(builder.fdiv(NUMBER(1.0), whole), len(powers))
        powers = [builder.fmul(row, share) for row in powers]
        for _ in range(SQUARINGS):
            powers = writer.product(powers, powers)
        found, size = writer.trace(powers), writer.root(whole)
        for _ in range(SQUARINGS + 1):
            found = writer.root(found)
        return builder.select(builder.fcmp_ordered(">", whole, NUMBER(0.0)), builder.fmul(size, found), size)

    return _written(types.float64, (A,), write)


_product: Any = intrinsic(_write_product)
_transposed_product: Any = intrinsic(_write_transposed_product)
_sum_of_rows: Any = intrinsic(_write_sum_of_rows)
_elimination: Any = intrinsic(_write_elimination)
_spectral_norm: Any = intrinsic(_write_spectral_norm)


@inline
def multiply(A, B, out):
    """Product out = A B; out may be A or B."""
    _product(A, B, out)


@inline
def transposed_multiply(A, B, out):
    """Product out = A^T B; out may be A or B."""
    _transposed_product(A, B, out)


@inline
def transposed_times(A, x, out):
    """Product out = A^T x; x and out need not be in records, but must be contiguous."""
    _sum_of_rows(A, x, out)


@inline
def eliminate(A, c):
    """Do step c of the inversion of A (n, n) in place by Gauss and Jordan, with the pivot on the diagonal."""
    _elimination(A, c)


@inline
def spectral_norm(A):
    """Upper bound of ||A||_2: its Schatten norm of order 64, at most k^(1/64) (3 % for 6 rows) too large."""
    return _spectral_norm(A)
