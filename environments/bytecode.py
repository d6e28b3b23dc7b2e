"""Bytecode of a formula with all its derivatives: a list of instructions for kernels, so that no formula needs
compiling.

Registers hold x, y, z, t, then the constants, then one result after the other. All bytecodes have the same size, and
so have the records around them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from environments.expression import VARIABLES, Graph, Op, T, X, Y, Z, operands
from environments.formula import Formula, FormulaError
from kernels import allocating, kernel

INSTRUCTIONS, REGISTERS = 512, 640
SHORT_INSTRUCTIONS, SHORT_REGISTERS = 64, 96  # of a value without derivatives

# what a bytecode computes: the value, then derivatives with respect to each of these in turn
OUTPUTS = ((), (X,), (Y,), (Z,), (X, X), (X, Y), (X, Z), (Y, Y), (Y, Z), (Z, Z), (T,), (X, T), (Y, T), (Z, T), (T, T))
VALUE, GRADIENT, HESSIAN, RATE, GRADIENT_RATE, SECOND_RATE = 0, 1, 4, 10, 11, 14


class Bytecode(NamedTuple):
    """Bytecode of a formula.
    code (INSTRUCTIONS, 3): operation and two registers, of which `length` count; the first result goes to register
    `first`.
    registers (REGISTERS,), with the constants in place.
    outputs (15,): the registers of `OUTPUTS`.
    K, K_inv, work (4, 4): memory for the search of the nearest point."""

    code: np.ndarray
    length: int
    first: int
    registers: np.ndarray
    outputs: np.ndarray
    K: np.ndarray
    K_inv: np.ndarray
    work: np.ndarray


def _bytecode(code: np.ndarray, length: int, first: int, registers: np.ndarray, outputs: np.ndarray) -> Bytecode:
    room = np.zeros((4, 4))
    return Bytecode(code, length, first, registers, outputs, room, room, room)


BLANK = _bytecode(
    np.zeros((INSTRUCTIONS, 3), np.int16), 0, 4, np.zeros(REGISTERS), np.zeros(len(OUTPUTS), np.int16)
)  # for surfaces that have no formula


def bytecode_of(formula: Formula) -> Bytecode:
    """Bytecode of a formula. Raises FormulaError when its derivatives are too long or not finite."""
    graph = formula.graph
    try:
        wanted = [formula.root] * len(OUTPUTS)
        for i, variables in enumerate(OUTPUTS):
            for variable in variables:
                wanted[i] = graph.derivative(wanted[i], variable)
    except ArithmeticError as error:
        raise FormulaError(f"in the formula's derivatives stands {error}; allowed: finite real numbers") from error
    code, length, first, registers, outputs = _assembled(graph, wanted, INSTRUCTIONS, REGISTERS)
    return _bytecode(code, length, first, registers, outputs)


class Function(NamedTuple):
    """Bytecode of a formula's value only, see `Bytecode`; output: the register of the value."""

    code: np.ndarray
    length: int
    first: int
    registers: np.ndarray
    output: int

    @classmethod
    def constant(cls, value: float) -> Function:
        """A number, which may be NaN."""
        registers = np.zeros(SHORT_REGISTERS)
        registers[len(VARIABLES)] = value
        return cls(np.zeros((SHORT_INSTRUCTIONS, 3), np.int16), 0, len(VARIABLES) + 1, registers, len(VARIABLES))

    @classmethod
    def of(cls, formula: Formula) -> Function:
        """Value of a formula. Raises FormulaError when it is too long."""
        parts = _assembled(formula.graph, [formula.root], SHORT_INSTRUCTIONS, SHORT_REGISTERS)
        return cls(*parts[:-1], int(parts[-1][0]))


def _assembled(
    graph: Graph, wanted: list[int], most: int, size: int
) -> tuple[np.ndarray, int, int, np.ndarray, np.ndarray]:
    """Code, its length, the first result's register, all registers, and the numbers of the registers that receive the
    wanted parts."""
    needed = graph.below(wanted)
    constants = [a for a in needed if graph.parts[a].op is Op.CONSTANT]
    results = [a for a in needed if graph.parts[a].op not in (Op.CONSTANT, Op.VARIABLE)]
    first = len(VARIABLES) + len(constants)
    if len(results) > most or first + len(results) > size:
        raise FormulaError(
            f"the formula{' and its derivatives need' if len(wanted) > 1 else ' needs'} {len(results)} operations and "
            f"{len(constants)} numbers; allowed: {most} operations, {size - len(VARIABLES)} in all"
        )
    place = {a: i for i, a in enumerate([*graph.variables, *constants, *results])}
    code, registers = np.zeros((most, 3), np.int16), np.zeros(size)
    for a in constants:
        registers[place[a]] = graph.parts[a].value
    for i, a in enumerate(results):
        sources = [place[b] for b in operands(graph.parts[a])]
        code[i, : 1 + len(sources)] = [graph.parts[a].op, *sources]
    return code, len(results), first, registers, np.array([place[a] for a in wanted], np.int16)


_ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _POWER, _NEGATE, _SQRT, _SIN, _COS, _TAN, _EXP, _LOG, _TANH, _ATAN = (
    int(op) for op in Op if op not in (Op.CONSTANT, Op.VARIABLE)
)


@kernel
def run(bytecode, x, y, z, t):
    """Fill the registers for one point (m) and instant (s)."""
    r = bytecode.registers
    r[0], r[1], r[2], r[3] = x, y, z, t
    _execute(bytecode.code, bytecode.length, bytecode.first, r)


@allocating
def value_of(function, x, y, z, t):
    """Value of a `Function` of its four variables; the function itself does not change."""
    r = function.registers.copy()
    r[0], r[1], r[2], r[3] = x, y, z, t
    _execute(function.code, function.length, function.first, r)
    return r[function.output]


@kernel
def _execute(code, length, first, r):
    for i in range(length):
        op, a, b = code[i, 0], r[code[i, 1]], r[code[i, 2]]
        if op == _MULTIPLY:
            c = a * b
        elif op == _ADD:
            c = a + b
        elif op == _SUBTRACT:
            c = a - b
        elif op == _NEGATE:
            c = -a
        elif op == _DIVIDE:
            c = a / b
        elif op == _SIN:
            c = np.sin(a)
        elif op == _COS:
            c = np.cos(a)
        elif op == _SQRT:
            c = np.sqrt(a)
        elif op == _EXP:
            c = np.exp(a)
        elif op == _POWER:
            c = a**b
        elif op == _TAN:
            c = np.tan(a)
        elif op == _LOG:
            c = np.log(a)
        elif op == _TANH:
            c = np.tanh(a)
        else:
            c = np.arctan(a)
        r[first + i] = c
