"""Table of control laws, and the compiled choice among them."""

from __future__ import annotations

from importlib import import_module

from controllers.control_law import ControlLaw
from controllers.laws import KINDS
from kernels import choice, inline

LAWS: dict[str, ControlLaw] = {kind: import_module(f"controllers.laws.{kind.replace('-', '_')}").LAW for kind in KINDS}


def fits_within(law: ControlLaw) -> bool:
    """Whether a law can be within the compiled period, whose data are the same under every law: it is compiled, and has
    neither a state nor parameters of its own."""
    return law.compiled and law.states is None and not law.parameters


WITHIN = tuple(kind for kind, law in LAWS.items() if fits_within(law))  # laws within the compiled period


def number_of(law: ControlLaw) -> int:
    """Number of a law within the compiled period, -1 for another law, which is called between the two halves of the
    period."""
    return WITHIN.index(law.kind) if LAWS.get(law.kind) is law and law.kind in WITHIN else -1


_torque = choice([LAWS[kind].torque for kind in WITHIN])


@inline
def torque(given, out):
    """Compute the torque of the law within the compiled period that `given.gains` names."""
    _torque(given.gains.law, given, out)
