"""Functions of the laws in a user's own files, tried before a law is used."""

from __future__ import annotations

import inspect
import operator
from collections.abc import Iterable
from pathlib import Path

from app.scenario.own_code import OwnCodeError, located, shown
from controllers.control_law import ControlLaw

MOST_STATES = 1000
COORDINATES = (2, 3, 6, 7)  # of the arms that come with the program


def require_callable(laws: Iterable[ControlLaw]) -> None:
    """Raise OwnCodeError for a law whose torque is no function or has other arguments than it gets, or whose `states`
    gives no length of a state."""
    for law in laws:
        if not callable(law.torque):
            raise OwnCodeError(f"--use: law {law.kind}: torque {shown(law.torque)}; allowed: a function")
        path = file_of(law)
        _require_arguments(law, path)
        if law.states is None:
            continue
        if not callable(law.states):
            raise OwnCodeError(
                f"--use {path}: states {shown(law.states)}; allowed: a function of the number of coordinates, such as "
                "states=lambda n: n"
            )
        for n in COORDINATES:
            _require_length(law, n, path)


def file_of(law: ControlLaw) -> Path:
    """File of the law's torque; the law's kind for what has no file, such as a `partial`."""
    try:
        return Path(inspect.getfile(inspect.unwrap(getattr(law.torque, "py_func", law.torque))))
    except TypeError:
        return Path(law.kind)


def _require_arguments(law: ControlLaw, path: Path) -> None:
    """Raise OwnCodeError where the torque does not take the arguments that it gets."""
    try:
        signature = inspect.signature(law.torque)
    except ValueError:  # a function that was not written in Python does not tell its arguments
        return
    given = ("given", "out") if law.states is None else ("given", "out", "x", "x_dot")
    try:
        signature.bind(*given)
    except TypeError as error:
        has, other = ("no states", "with") if law.states is None else ("states", "without")
        instead = "torque(given, out, x, x_dot)" if law.states is None else "torque(given, out)"
        raise OwnCodeError(
            f"--use {path}: torque{signature!s:.60} in a law with {has}; allowed: torque({', '.join(given)}), or "
            f"{instead} {other} states"
        ) from error


def _require_length(law: ControlLaw, n: int, path: Path) -> None:
    """Raise OwnCodeError where `states` gives no length for n coordinates."""
    assert law.states is not None
    try:
        length = law.states(n)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise OwnCodeError(f"--use {located(error, path)}") from error
    try:
        whole = operator.index(length)
    except TypeError:
        whole = -1
    if not 0 <= whole <= MOST_STATES:
        raise OwnCodeError(
            f"--use {path}: states gives {shown(length)} for {n} coordinates; allowed: a whole number, 0 to "
            f"{MOST_STATES}"
        )
