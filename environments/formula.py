"""Grammar of typed formulas. A text is read by these few functions and never evaluated as code:

    sum    = term  { ("+" | "-") term }
    term   = signed { ("*" | "/") signed }
    signed = { "+" | "-" } power
    power  = atom [ ("^" | "**") signed ]            the exponent is a constant
    atom   = number | variable | "pi" | function "(" sum { "," sum } ")" | "(" sum ")"

A surface's variables are x, y, z, t; another formula may have other names for up to four of its own. Only functions
with derivatives are admitted: no abs, min or max.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from environments.expression import Graph, Op

LONGEST = 500  # characters
DEEPEST = 40  # brackets, exponents and signs within each other
LARGEST = 1e12  # a number's size
STEEPEST = 100.0  # an exponent's size

VARIABLES = ("x", "y", "z", "t")
FUNCTIONS = {
    "sin": Op.SIN, "cos": Op.COS, "tan": Op.TAN, "exp": Op.EXP, "log": Op.LOG, "sqrt": Op.SQRT,
    "tanh": Op.TANH, "atan": Op.ATAN,
}  # fmt: skip
SURFACE = "z - 0.1 - 0.02*sin(6*x - 2*t)"


def _allowed(variables: Sequence[str], example: str) -> str:
    return (
        f"numbers, {', '.join((*variables, 'pi'))}, + - * / ^ ( ), and {', '.join(FUNCTIONS)} and hypot, "
        f'such as "{example}"'
    )


ALLOWED = _allowed(VARIABLES, SURFACE)
_TOKEN = re.compile(
    r"(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)|(?P<name>[A-Za-z_]+)|(?P<sign>\*\*|[-+*/^(),])"
)


class FormulaError(ValueError):
    """A text that is no formula, or one that cannot be used: one sentence with the place, and what is allowed."""


class _Token(NamedTuple):
    kind: str  # number, name, sign or end
    text: str
    place: int  # of its first character, counted from 1


@dataclass(frozen=True)
class Formula:
    """A formula that was read: part `root` of `graph`."""

    text: str
    graph: Graph
    root: int


def parse(text: str, variables: Sequence[str] = VARIABLES, example: str = SURFACE) -> Formula:
    """Formula of a text. Raises FormulaError, whose sentence names what is allowed.

    variables: their names, at most four; example: a formula of them, for the sentence.
    """
    if len(text) > LONGEST:
        raise FormulaError(f"the formula has {len(text)} characters; allowed: {LONGEST}")
    return _Reader(text, variables, _allowed(variables, example)).formula()


def _tokens(text: str, allowed: str) -> list[_Token]:
    tokens, at = [], 0
    while at < len(text):
        if text[at].isspace():
            at += 1
            continue
        match = _TOKEN.match(text, at)
        if match is None or match.lastgroup is None:
            raise FormulaError(f"{text[at]!r} at character {at + 1} cannot be read; allowed: {allowed}")
        tokens.append(_Token(match.lastgroup, match.group(), at + 1))
        at = match.end()
    return [*tokens, _Token("end", "", len(text) + 1)]


class _Reader:
    """Reader of one text into a graph; each method reads the rule of the grammar that has its name."""

    def __init__(self, text: str, variables: Sequence[str], allowed: str) -> None:
        self._text, self._variables, self._allowed = text, variables, allowed
        self._tokens = _tokens(text, allowed)
        self._at = 0
        self._depth = 0
        self._graph = Graph()

    def formula(self) -> Formula:
        if self._next.kind == "end":
            raise FormulaError(f"the formula is empty; allowed: {self._allowed}")
        root = self._sum()
        if self._next.kind != "end":
            raise self._unexpected("an operator or the end")
        return Formula(self._text, self._graph, root)

    @property
    def _next(self) -> _Token:
        return self._tokens[self._at]

    def _take(self, *texts: str) -> _Token | None:
        """Take the next token if it is one of these signs, else return None."""
        token = self._next
        if token.kind == "sign" and token.text in texts:
            self._at += 1
            return token
        return None

    def _require(self, sign: str) -> None:
        if self._take(sign) is None:
            raise self._unexpected(f'"{sign}"')

    def _unexpected(self, wanted: str) -> FormulaError:
        token = self._next
        if token.kind == "end":
            return FormulaError(f"the formula ends where {wanted} is needed")
        return FormulaError(f'"{token.text}" at character {token.place} where {wanted} is needed')

    def _deeper(self, read: Callable[[], int]) -> int:
        if self._depth >= DEEPEST:
            raise FormulaError(f"at character {self._next.place} more than {DEEPEST} levels are open; allowed: fewer")
        self._depth += 1
        part = read()
        self._depth -= 1
        return part

    def _made(self, place: int, make: Callable[[], int]) -> int:
        try:
            return make()
        except ArithmeticError as error:  # a division by 0, an overflow, the root of a negative number
            raise FormulaError(f"at character {place} stands {error}; allowed: finite real numbers") from error

    def _sum(self) -> int:
        left = self._term()
        while sign := self._take("+", "-"):
            right = self._term()
            make = self._graph.add if sign.text == "+" else self._graph.subtract
            left = self._made(sign.place, lambda a=left, b=right, make=make: make(a, b))
        return left

    def _term(self) -> int:
        left = self._signed()
        while sign := self._take("*", "/"):
            right = self._signed()
            make = self._graph.multiply if sign.text == "*" else self._graph.divide
            left = self._made(sign.place, lambda a=left, b=right, make=make: make(a, b))
        return left

    def _signed(self) -> int:
        sign = self._take("+", "-")
        if sign is None:
            return self._power()
        part = self._deeper(self._signed)
        return part if sign.text == "+" else self._graph.negate(part)

    def _power(self) -> int:
        base = self._atom()
        sign = self._take("^", "**")
        if sign is None:
            return base
        place = self._next.place
        exponent = self._graph.value(self._deeper(self._signed))
        if exponent is None:
            raise FormulaError(f"the exponent at character {place} depends on a variable; allowed: a constant")
        if abs(exponent) > STEEPEST:
            raise FormulaError(f"the exponent at character {place} is {exponent:g}; allowed: at most {STEEPEST:g}")
        return self._made(sign.place, lambda: self._graph.power(base, exponent))

    def _atom(self) -> int:
        token = self._next
        if token.kind == "number":
            self._at += 1
            value = float(token.text)
            if abs(value) > LARGEST:
                raise FormulaError(f"{token.text:.20} at character {token.place}; allowed: numbers up to {LARGEST:g}")
            return self._graph.constant(value)
        if token.kind == "name":
            self._at += 1
            return self._named(token)
        if self._take("("):
            part = self._deeper(self._sum)
            self._require(")")
            return part
        raise self._unexpected('a number, a name or "("')

    def _named(self, token: _Token) -> int:
        name = token.text
        if name in self._variables:
            return self._graph.variables[self._variables.index(name)]
        if name == "pi":
            return self._graph.constant(math.pi)
        if name not in FUNCTIONS and name != "hypot":
            raise FormulaError(f'"{name:.20}" at character {token.place} is unknown; allowed: {self._allowed}')
        arguments = self._arguments()
        count = 2 if name == "hypot" else 1
        if len(arguments) != count:
            raise FormulaError(f"{name} at character {token.place} has {len(arguments)} arguments; allowed: {count}")
        return self._made(token.place, lambda: self._called(name, arguments))

    def _arguments(self) -> list[int]:
        self._require("(")
        arguments = [self._deeper(self._sum)]
        while self._take(","):
            arguments.append(self._deeper(self._sum))
        self._require(")")
        return arguments

    def _called(self, name: str, arguments: list[int]) -> int:
        graph = self._graph
        if name != "hypot":
            return graph.apply(FUNCTIONS[name], arguments[0])
        return graph.apply(Op.SQRT, graph.add(*(graph.multiply(a, a) for a in arguments)))
