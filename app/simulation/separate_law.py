"""A law that is called between the two halves of a compiled period: one of a user's own file, or one with a state of
its own."""

from __future__ import annotations

import inspect
from collections import namedtuple
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from app.process.own_code import OwnCodeError, located
from app.simulation.control_period import Period, Setting, asked
from controllers.control_law import ControlLaw
from controllers.controller import Controller
from kernels import not_kept
from kernels.records import Fields, Record


class SeparateLaw:
    """The torque of one law with its parameters. settings: what the compiled halves read of the system; x_dot (k,): the
    rate of the law's own state in the period that was evaluated last."""

    def __init__(self, controller: Controller, settings: Record[Setting]) -> None:
        law, self._settings = controller.law, settings.data
        self._ask, self._file = asked(law.torque).py_func, _file_of(law)
        self._parameters = _parameters(controller)
        self._x, self.x_dot = law.at_rest(controller.model.n), law.at_rest(controller.model.n)
        self._state = () if law.states is None else (self._x, self.x_dot)
        self._setting = Fields(settings.data)
        self._seen: tuple[np.ndarray, Fields] | None = None
        self._act = self._compiled(_kernel_of(law)) if law.compiled else self._interpreted

    def act(self, period: Record[Period], x: np.ndarray) -> None:
        """Write the terms of the torque into the period, and `x_dot`, for the law's own state x (k,). Raises
        OwnCodeError."""
        self._x[:], self.x_dot[:] = x, 0.0
        try:
            self._act(period.data)
        except Exception as error:
            raise OwnCodeError(located(error, self._file)) from error

    def _interpreted(self, period: np.ndarray) -> None:
        if self._seen is None or self._seen[0] is not period:
            self._seen = period, Fields(period)
        parameters = self._setting.gains if self._parameters is None else self._parameters
        self._ask(self._setting, self._seen[1], parameters, *self._state)

    def _compiled(self, kernel: Callable[..., None]) -> Callable[[np.ndarray], None]:
        parameters = self._settings["gains"] if self._parameters is None else Record(self._parameters).data
        return lambda period: kernel(self._settings, period, parameters, *self._state)


def _parameters(controller: Controller) -> Any:
    """The law's own parameters as a named tuple, None without any."""
    if not controller.parameters:
        return None
    return namedtuple("Parameters", controller.parameters)(**controller.parameters)


@cache
def _kernel_of(law: ControlLaw) -> Callable[..., None]:
    ask = asked(law.torque)

    @not_kept
    def answer(setting, period, parameters, *state):
        ask(setting[0], period[0], parameters[0], *state)

    return answer


def _file_of(law: ControlLaw) -> Path:
    return Path(inspect.getfile(getattr(law.torque, "py_func", law.torque)))
