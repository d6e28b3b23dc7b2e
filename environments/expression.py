"""Expressions in x, y, z, t as one graph in which equal parts exist once, and their exact derivatives.

Parts are numbered so that the operands of a part have smaller numbers: every walk is a loop, none is a recursion.
Making a part simplifies it (constants folded, 0 and 1 removed), so that derivatives stay as short as their functions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from enum import IntEnum, auto
from typing import NamedTuple

X, Y, Z, T = VARIABLES = range(4)


class Op(IntEnum):
    """Operation of a part on its operands a and b."""

    CONSTANT = 0
    VARIABLE = auto()
    ADD = auto()
    SUBTRACT = auto()
    MULTIPLY = auto()
    DIVIDE = auto()
    POWER = auto()  # with a constant exponent, part b
    NEGATE = auto()
    SQRT = auto()
    SIN = auto()
    COS = auto()
    TAN = auto()
    EXP = auto()
    LOG = auto()
    TANH = auto()
    ATAN = auto()


FUNCTIONS: dict[Op, Callable[[float], float]] = {
    Op.SQRT: math.sqrt,
    Op.SIN: math.sin,
    Op.COS: math.cos,
    Op.TAN: math.tan,
    Op.EXP: math.exp,
    Op.LOG: math.log,
    Op.TANH: math.tanh,
    Op.ATAN: math.atan,
}


class ExpressionNode(NamedTuple):
    """A node of the graph: operation, operands by number, and the value of a constant."""

    op: Op
    a: int = -1
    b: int = -1
    value: float = 0.0


class Graph:
    """Graph of all parts made so far. Methods that make a part return its number, the same one for the same part.

    Raises ArithmeticError where a constant would be no finite real number.
    """

    def __init__(self) -> None:
        self.parts: list[ExpressionNode] = []
        self._numbers: dict[ExpressionNode, int] = {}
        self._derivatives: dict[tuple[int, int], int] = {}
        self.variables = tuple(self._number(ExpressionNode(Op.VARIABLE, v)) for v in VARIABLES)
        self.zero, self.one = self.constant(0.0), self.constant(1.0)

    def _number(self, part: ExpressionNode) -> int:
        if part not in self._numbers:
            self._numbers[part] = len(self.parts)
            self.parts.append(part)
        return self._numbers[part]

    def constant(self, value: float) -> int:
        if not math.isfinite(value):
            raise ArithmeticError("a number that is too large")
        return self._number(ExpressionNode(Op.CONSTANT, value=value + 0.0))  # -0.0 is 0.0

    def value(self, a: int) -> float | None:
        """Value of a constant; None for any other part."""
        part = self.parts[a]
        return part.value if part.op is Op.CONSTANT else None

    def add(self, a: int, b: int) -> int:
        u, v = self.value(a), self.value(b)
        if u is not None and v is not None:
            return self.constant(u + v)
        if u == 0.0 or v == 0.0:
            return b if u == 0.0 else a
        if self.parts[b].op is Op.NEGATE:
            return self.subtract(a, self.parts[b].a)
        if self.parts[a].op is Op.NEGATE:
            return self.subtract(b, self.parts[a].a)
        return self._number(ExpressionNode(Op.ADD, min(a, b), max(a, b)))

    def subtract(self, a: int, b: int) -> int:
        u, v = self.value(a), self.value(b)
        if u is not None and v is not None:
            return self.constant(u - v)
        if a == b:
            return self.zero
        if v == 0.0:
            return a
        if u == 0.0:
            return self.negate(b)
        if self.parts[b].op is Op.NEGATE:
            return self.add(a, self.parts[b].a)
        return self._number(ExpressionNode(Op.SUBTRACT, a, b))

    def negate(self, a: int) -> int:
        part = self.parts[a]
        if part.op is Op.CONSTANT:
            return self.constant(-part.value)
        if part.op is Op.NEGATE:
            return part.a
        if part.op is Op.SUBTRACT:
            return self.subtract(part.b, part.a)
        return self._number(ExpressionNode(Op.NEGATE, a))

    def multiply(self, a: int, b: int) -> int:
        u, v = self.value(a), self.value(b)
        if u is not None and v is not None:
            return self.constant(u * v)
        if u is not None:
            return self._scaled(u, b)
        if v is not None:
            return self._scaled(v, a)
        if self.parts[a].op is Op.NEGATE:
            return self.negate(self.multiply(self.parts[a].a, b))
        if self.parts[b].op is Op.NEGATE:
            return self.negate(self.multiply(a, self.parts[b].a))
        for one, other in ((a, b), (b, a)):  # numbers to the front, where they are combined
            factor = self.value(self.parts[one].a) if self.parts[one].op is Op.MULTIPLY else None
            if factor is not None:
                return self._scaled(factor, self.multiply(self.parts[one].b, other))
        return self._number(ExpressionNode(Op.MULTIPLY, min(a, b), max(a, b)))

    def _scaled(self, factor: float, a: int) -> int:
        part = self.parts[a]
        if factor == 0.0:
            return self.zero
        if factor == 1.0:
            return a
        if factor == -1.0:
            return self.negate(a)
        if part.op is Op.NEGATE:
            return self._scaled(-factor, part.a)
        if part.op is Op.MULTIPLY and (inner := self.value(part.a)) is not None:
            return self.multiply(self.constant(factor * inner), part.b)
        return self._number(ExpressionNode(Op.MULTIPLY, self.constant(factor), a))

    def divide(self, a: int, b: int) -> int:
        u, v = self.value(a), self.value(b)
        if v == 0.0:
            raise ArithmeticError("a division by 0")
        if u is not None and v is not None:
            return self.constant(u / v)
        if u == 0.0:
            return self.zero
        if v == 1.0:
            return a
        return self._number(ExpressionNode(Op.DIVIDE, a, b))

    def power(self, a: int, exponent: float) -> int:
        base = self.value(a)
        if base is not None:
            return self.constant(_real(math.pow, base, exponent))
        match exponent:
            case 0.0:
                return self.one
            case 1.0:
                return a
            case 2.0:
                return self.multiply(a, a)
            case 0.5:
                return self.apply(Op.SQRT, a)
            case -1.0:
                return self.divide(self.one, a)
        return self._number(ExpressionNode(Op.POWER, a, self.constant(exponent)))

    def apply(self, function: Op, a: int) -> int:
        """One of `FUNCTIONS` applied to a part."""
        value = self.value(a)
        return (
            self._number(ExpressionNode(function, a))
            if value is None
            else self.constant(_real(FUNCTIONS[function], value))
        )

    def below(self, roots: Iterable[int]) -> list[int]:
        """All parts that the roots are made of, themselves included, in ascending order."""
        found, waiting = set(), list(roots)
        while waiting:
            a = waiting.pop()
            if a not in found:
                found.add(a)
                waiting += operands(self.parts[a])
        return sorted(found)

    def derivative(self, root: int, variable: int) -> int:
        """Partial derivative of a part with respect to one of `VARIABLES`, exact."""
        for a in self.below([root]):
            if (a, variable) not in self._derivatives:
                self._derivatives[a, variable] = self._derivative(a, variable)
        return self._derivatives[root, variable]

    def _derivative(self, number: int, variable: int) -> int:
        op, a, b, _ = self.parts[number]
        if op is Op.CONSTANT:
            return self.zero
        if op is Op.VARIABLE:
            return self.one if a == variable else self.zero
        da = self._derivatives[a, variable]
        if op in (Op.ADD, Op.SUBTRACT, Op.MULTIPLY, Op.DIVIDE):
            db = self._derivatives[b, variable]
            match op:
                case Op.ADD:
                    return self.add(da, db)
                case Op.SUBTRACT:
                    return self.subtract(da, db)
                case Op.MULTIPLY:
                    return self.add(self.multiply(da, b), self.multiply(a, db))
            return self.divide(self.subtract(da, self.multiply(number, db)), b)
        if da == self.zero:
            return da
        return self.multiply(self._slope(number), da)

    def _slope(self, number: int) -> int:
        """Derivative of a part with one operand with respect to that operand."""
        op, a, b, _ = self.parts[number]
        match op:
            case Op.NEGATE:
                return self.constant(-1.0)
            case Op.POWER:
                exponent = self.parts[b].value
                return self.multiply(b, self.power(a, exponent - 1.0))
            case Op.SQRT:
                return self.divide(self.constant(0.5), number)
            case Op.SIN:
                return self.apply(Op.COS, a)
            case Op.COS:
                return self.negate(self.apply(Op.SIN, a))
            case Op.TAN:
                return self.add(self.one, self.multiply(number, number))
            case Op.EXP:
                return number
            case Op.LOG:
                return self.divide(self.one, a)
            case Op.TANH:
                return self.subtract(self.one, self.multiply(number, number))
            case Op.ATAN:
                return self.divide(self.one, self.add(self.one, self.multiply(a, a)))
        raise AssertionError(op)


def _real(function: Callable[..., float], *arguments: float) -> float:
    try:
        return function(*arguments)
    except OverflowError as error:
        raise ArithmeticError("a number that is too large") from error
    except ValueError as error:
        raise ArithmeticError("what is no real number") from error


def operands(part: ExpressionNode) -> list[int]:
    """Numbers of a part's operands."""
    return [] if part.op in (Op.CONSTANT, Op.VARIABLE) else [c for c in (part.a, part.b) if c >= 0]
