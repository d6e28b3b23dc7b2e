"""Fuzzing of the formula of a typed surface."""

from contextlib import suppress

from environments.bytecode import bytecode_of
from environments.formula import ALLOWED, FormulaError, parse

SEEDS = (b"z - 0.1 - 0.02*sin(6*x - 2*t)", b"hypot(x, y)^1.5/exp(-z) + atan(log(t))", b"2^-1*sqrt(tan(x))**2")
DICTIONARY = (*ALLOWED.split(), "**", "1e12", "pi", ".5e-1")


def read(data: bytes) -> None:
    with suppress(FormulaError, UnicodeDecodeError):
        bytecode_of(parse(data.decode()))
