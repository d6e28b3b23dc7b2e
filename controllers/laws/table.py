"""The table of control laws, and the compiled choice among them."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from controllers.control_law import ControlLaw
from controllers.laws import KINDS
from kernels import part

LAWS: dict[str, ControlLaw] = {kind: import_module(f"controllers.laws.{kind.replace('-', '_')}").LAW for kind in KINDS}
WITHIN = tuple(kind for kind, law in LAWS.items() if law.compiled and law.states is None)  # within the compiled period


def number_of(law: ControlLaw) -> int:
    """Which of the laws within the compiled period this is, -1 for another one, which is called between its halves."""
    return WITHIN.index(law.kind) if LAWS.get(law.kind) is law and law.kind in WITHIN else -1


def _choice(number: int) -> Callable[..., Any]:
    """`torque(told, out)` of the laws from this number on, compiled, by the number of the law in `told.gains`."""
    if number == len(WITHIN):

        @part
        def unknown(_told, _out):
            raise ValueError("gains.law: no law of this number within the compiled period")

        return unknown
    torque, others = LAWS[WITHIN[number]].torque, _choice(number + 1)

    @part
    def chosen(told, out):
        if told.gains.law == number:
            torque(told, out)
        else:
            others(told, out)

    return chosen


torque = _choice(0)
