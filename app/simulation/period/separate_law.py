"""Separate law, which is called between the two halves of a compiled period: one of a user's own file, or one with a
state of its own."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np

from app.scenario.own_code import OwnCodeError, located
from app.scenario.own_laws import file_of
from app.simulation.period.control_period import Evaluation, Setting, with_law_input
from controllers.control_law import ControlLaw, no_parameters
from controllers.controller import Controller
from kernels import Kernel, address_for, inline, not_kept
from kernels.records import Record

Act = Callable[[Record[Evaluation]], None]


class LawMemory(NamedTuple):
    """Memory of a law.
    parameters: (p,), the values of its own parameters.
    x: (k,), its own state in the period that is evaluated; x_dot: (k,), the rate of it that the law has written."""

    parameters: np.ndarray
    x: np.ndarray
    x_dot: np.ndarray

    @classmethod
    def of(cls, controller: Controller) -> LawMemory:
        """Memory of a controller's law, with its state at rest."""
        law, n = controller.law, controller.model.n
        return cls(np.array(list(controller.parameters.values()), float), law.at_rest(n), law.at_rest(n))


class SeparateLaw:
    """Torque of one law with its parameters.
    settings: the data of the system that the compiled halves read.
    memory: of the law."""

    def __init__(self, controller: Controller, settings: Record[Setting]) -> None:
        law = controller.law
        self.memory, self._settings, self._file = LawMemory.of(controller), settings, file_of(law)
        names = tuple(controller.parameters)
        self._kernel = _kernel_of(law, names) if law.compiled else None
        self._act = self._compiled if self._kernel is not None else _interpreted(law, settings, names, self.memory)

    def act(self, evaluation: Record[Evaluation], x: np.ndarray) -> None:
        """Write the terms of the torque into the evaluation, and the rate of the law's own state x (k,) into the
        memory. Raises OwnCodeError."""
        self.memory.x[:], self.memory.x_dot[:] = x, 0.0
        try:
            self._act(evaluation)
        except (Exception, SystemExit) as error:
            raise self.explained(error) from error

    def address(self, evaluation: np.ndarray) -> int:
        """Address in this process of the compiled torque, for `kernels.pointers.ask` with setting, evaluation and
        memory; 0 for a law in plain numpy."""
        return 0 if self._kernel is None else address_for(self._kernel, self._settings.data, evaluation, *self.memory)

    def explained(self, error: BaseException) -> OwnCodeError:
        """Error of the law's torque, with its file, and the line where that is known."""
        return OwnCodeError(located(error, self._file))

    def _compiled(self, evaluation: Record[Evaluation]) -> None:
        assert self._kernel is not None
        self._kernel(self._settings.data, evaluation.data, *self.memory)


def _interpreted(law: ControlLaw, settings: Record[Setting], names: tuple[str, ...], memory: LawMemory) -> Act:
    """The law's torque in the interpreter. names: of its parameters. What the law gets is read-only: a slip in a line
    such as `J_q *= 2` would change the arm's estimates instead of a torque."""
    given, state = settings.read_only, () if law.states is None else (memory.x, memory.x_dot)
    ask = with_law_input(law.torque).py_func
    own = namedtuple("Parameters", names)(*memory.parameters.tolist()) if names else no_parameters.py_func(given.gains)
    return lambda evaluation: ask(given, _guarded(evaluation), own, *state)


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


@cache
def _kernel_of(law: ControlLaw, names: tuple[str, ...]) -> Kernel:
    """Kernel of a law's torque, with arguments of the same types for every law. names: of its parameters."""
    ask = with_law_input(law.torque if law.states is not None else _without_state(law.torque))
    own = _named(names) if names else _unnamed

    @not_kept
    def answer(setting, evaluation, parameters, x, x_dot):
        ask(setting[0], evaluation[0], own(setting[0].gains, parameters), x, x_dot)

    return answer


def _without_state(torque: Any) -> Any:
    """Inline kernel of a torque that has no state."""

    @inline
    def stateless(given, out, _x, _x_dot):
        torque(given, out)

    return stateless


def _named(names: tuple[str, ...]) -> Any:
    """Inline kernel that gives the values of parameters their names."""
    from numba.np.unsafe import ndarray  # numba is imported only where something is compiled

    Parameters, count, fixed = namedtuple("Parameters", names), len(names), cast(Any, ndarray.to_fixed_tuple)

    @inline
    def named(_gains, values):
        return Parameters(*fixed(values, count))

    return named


@inline
def _unnamed(gains, _values):
    """Parameters of a law without any."""
    return no_parameters(gains)
