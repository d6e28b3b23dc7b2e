"""Bytecode of a formula with all its derivatives: a list of instructions for kernels, so that no formula needs
compiling.

Registers hold x, y, z, t, then the constants, then one result after the other. All bytecodes have the same size, and
so have the records around them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from environments.expression import VARIABLES, Op, T, X, Y, Z, operands
from environments.formula import Formula, FormulaError
from kernels import kernel

INSTRUCTIONS, REGISTERS = 512, 640

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
    needed = graph.below(wanted)
    constants = [a for a in needed if graph.parts[a].op is Op.CONSTANT]
    results = [a for a in needed if graph.parts[a].op not in (Op.CONSTANT, Op.VARIABLE)]
    first = len(VARIABLES) + len(constants)
    if len(results) > INSTRUCTIONS or first + len(results) > REGISTERS:
        raise FormulaError(
            f"the formula and its derivatives need {len(results)} operations and {len(constants)} numbers; "
            f"allowed: {INSTRUCTIONS} operations, {REGISTERS - len(VARIABLES)} in all"
        )
    place = {a: i for i, a in enumerate([*graph.variables, *constants, *results])}
    code, registers = np.zeros((INSTRUCTIONS, 3), np.int16), np.zeros(REGISTERS)
    for a in constants:
        registers[place[a]] = graph.parts[a].value
    for i, a in enumerate(results):
        sources = [place[b] for b in operands(graph.parts[a])]
        code[i, : 1 + len(sources)] = [graph.parts[a].op, *sources]
    outputs = np.array([place[a] for a in wanted], np.int16)
    return _bytecode(code, len(results), first, registers, outputs)


_ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _POWER, _NEGATE, _SQRT, _SIN, _COS, _TAN, _EXP, _LOG, _TANH, _ATAN = (
    int(op) for op in Op if op not in (Op.CONSTANT, Op.VARIABLE)
)


@kernel
def run(bytecode, x, y, z, t):
    """Fill the registers for one point (m) and instant (s)."""
    r, code = bytecode.registers, bytecode.code
    r[0], r[1], r[2], r[3] = x, y, z, t
    for i in range(bytecode.length):
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
        r[bytecode.first + i] = c
