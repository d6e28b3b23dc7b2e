"""Engines of a run: what computes its control periods."""

from typing import Literal

Engine = Literal["pinocchio", "compiled"]  # `ClosedLoop.step` with Pinocchio; many periods in one call, `compiled_run`
