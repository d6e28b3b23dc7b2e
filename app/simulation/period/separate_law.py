"""Separate law, which is called between the two halves of a compiled period: one of a user's own file, or one with a
state of its own."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from app.scenario.own_code import OwnCodeError, located
from app.scenario.own_laws import file_of
from app.simulation.period.control_period import Evaluation, Setting, with_law_input
from controllers.control_law import ControlLaw, no_parameters
from controllers.controller import Controller
from kernels import not_kept
from kernels.records import Record


class SeparateLaw:
    """Torque of one law with its parameters.
    settings: the data of the system that the compiled halves read.
    x_dot: (k,), the rate of the law's own state in the period that was evaluated last."""

    def __init__(self, controller: Controller, settings: Record[Setting]) -> None:
        law, n = controller.law, controller.model.n
        self._x, self.x_dot = law.at_rest(n), law.at_rest(n)
        self._state = () if law.states is None else (self._x, self.x_dot)
        self._file = file_of(law)
        self._torque = (_compiled if law.compiled else _interpreted)(law, settings, _parameters(controller))

    def act(self, evaluation: Record[Evaluation], x: np.ndarray) -> None:
        """Write the terms of the torque into the evaluation, and the rate of the law's own state x (k,) into `x_dot`.
        Raises OwnCodeError."""
        self._x[:], self.x_dot[:] = x, 0.0
        try:
            self._torque(evaluation, *self._state)
        except (Exception, SystemExit) as error:
            raise OwnCodeError(located(error, self._file)) from error


def _interpreted(law: ControlLaw, settings: Record[Setting], parameters: Any) -> Callable[..., None]:
    """The law's torque as a function of an evaluation and of the law's own state, in the interpreter. What the law
    gets is read-only: a slip in a line such as `J_q *= 2` would change the arm's estimates instead of a torque."""
    given = settings.read_only
    ask, own = with_law_input(law.torque).py_func, parameters or no_parameters.py_func(given.gains)
    return lambda evaluation, *state: ask(given, _guarded(evaluation), own, *state)


def _guarded(evaluation: Record[Evaluation]) -> SimpleNamespace:
    """Evaluation of which a law can only write its output and its working memory."""
    read, written = evaluation.read_only, evaluation.fields
    seen = read.seen
    return SimpleNamespace(
        seen=SimpleNamespace(
            task=seen.task, estimate=seen.estimate, q=seen.q, q_dot=seen.q_dot, work=written.seen.work
        ),
        reference=read.reference,
        feedforward=read.feedforward,
        z=read.z,
        F=read.F,
        output=written.output,
    )


def _compiled(law: ControlLaw, settings: Record[Setting], parameters: Any) -> Callable[..., None]:
    """The law's torque as a function of an evaluation and of the law's own state, compiled."""
    answer = _kernel_of(law)
    own = Record(parameters).data if parameters else no_parameters.py_func(settings.data["gains"])
    return lambda evaluation, *state: answer(settings.data, evaluation.data, own, *state)


def _parameters(controller: Controller) -> Any:
    """The law's own parameters as a named tuple, None without any."""
    if not controller.parameters:
        return None
    return namedtuple("Parameters", controller.parameters)(**controller.parameters)


@cache
def _kernel_of(law: ControlLaw) -> Callable[..., None]:
    ask = with_law_input(law.torque)

    @not_kept
    def answer(setting, evaluation, parameters, *state):
        ask(setting[0], evaluation[0], parameters[0], *state)

    return answer
