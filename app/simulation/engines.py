"""Engines of a run: what computes its control periods."""

from contextvars import ContextVar
from typing import Literal

Engine = Literal["pinocchio", "compiled"]  # `ClosedLoop.step` with Pinocchio; many periods in one call, `compiled_run`
in_force: ContextVar[Engine] = ContextVar("in_force", default="pinocchio")  # engine of a run whose caller names none
