"""Error model, the controller's knowledge of its model's errors at each state: whether the links' centres of mass and
shapes are uncertain, and the bounds of (7) that a scenario states itself."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.scenario.errors import ScenarioError
from app.scenario.schema import STATED_IN, Declared, Scenario, StatedBound
from controllers.nominal_model import turning
from environments.bytecode import Function, value_of
from environments.formula import FormulaError, parse
from kernels import inline, kernel
from kernels.records import Record

LOOKS, FASTEST, FARTHEST = 25, 20.0, 4.0  # states at which a formula is tried: their number, rad/s, rad
FASTER, SLOPES = 0.01, 16  # rad/s beyond the present speed, and steps from rest to there: where slopes are taken
UNSTATED_FUNCTION = Function.constant(np.nan)


class ErrorModel(NamedTuple):
    """Errors of a model.
    turning: whether `nominal_model.turning` is needed.
    states_M, states_C, states_G, states_f: which of the four bounds are stated.
    M, C, G, f: the stated bounds, each a function of its variables in `schema.STATED_IN`: away (rad), speed (rad/s),
    t (s).
    q_0: (n,) rad, from which `away` counts."""

    turning: bool
    states_M: bool
    states_C: bool
    states_G: bool
    states_f: bool
    M: Function
    C: Function
    G: Function
    f: Function
    q_0: np.ndarray

    @classmethod
    def none(cls, n: int) -> ErrorModel:
        """Model without doubts, of an arm with n joints."""
        return cls(
            turning=False,
            states_M=False,
            states_C=False,
            states_G=False,
            states_f=False,
            M=UNSTATED_FUNCTION,
            C=UNSTATED_FUNCTION,
            G=UNSTATED_FUNCTION,
            f=UNSTATED_FUNCTION,
            q_0=np.zeros(n),
        )

    @classmethod
    def of(cls, scenario: Scenario, q_0: np.ndarray) -> ErrorModel:
        """Errors that a scenario declares. Raises ScenarioError."""
        declared, duration = scenario.declared, scenario.simulation.duration
        M, C, G, f = (_function(declared, name, duration) for name in STATED_IN)
        return cls(
            turning=declared.link_centre > 0.0 or declared.link_shape > 0.0,
            states_M=declared.delta_M is not None,
            states_C=declared.delta_C is not None,
            states_G=declared.delta_G is not None,
            states_f=declared.delta_f is not None,
            M=M,
            C=C,
            G=G,
            f=f,
            q_0=q_0,
        )


def _function(declared: Declared, name: str, duration: float) -> Function:
    """Stated bound of this name, tried over the values that its variables may take. Raises ScenarioError."""
    given: StatedBound = getattr(declared, name)
    if given is None:
        return UNSTATED_FUNCTION
    if not isinstance(given, str):
        return Function.constant(float(given))
    names, example = STATED_IN[name]
    try:
        function = Function.of(parse(given, names, example))
    except FormulaError as error:
        raise ScenarioError(f"declared.{name}: {error}") from error
    record = Record(function).data
    ends = {"away": FARTHEST, "speed": FASTEST, "t": duration}
    places = np.meshgrid(*(np.linspace(0.0, ends[each], LOOKS) for each in names))
    for place in zip(*(axis.ravel() for axis in places), strict=True):
        value = float(_value_alone(record, *place, *(4 - len(names)) * (0.0,)))
        if not 0.0 <= value < np.inf:
            where = ", ".join(f"{each} = {at:.3g}" for each, at in zip(names, place, strict=True))
            raise ScenarioError(
                f"declared.{name}: {given!r:.60} is {value:.3g} at {where}; allowed: finite values >= 0 for "
                + ", ".join(f"{each} from 0 to {ends[each]:g}" for each in names)
            )
    return function


@kernel
def _value_alone(function, x, y, z, t):
    return value_of(function[0], x, y, z, t)


@inline
def estimate_errors(model, links, placements, q, q_dot, t, estimate):
    """Compute the fields of `estimate` about errors: M_turning, spin and stated. To be called after `estimates`."""
    if model.turning:
        turning(links, placements, estimate)
    stated, away, speed = estimate.stated, 0.0, 0.0
    for i in range(q.shape[0]):
        away += (q[i] - model.q_0[i]) ** 2
        speed += q_dot[i] ** 2
    away, speed = np.sqrt(away), np.sqrt(speed)
    stated.delta_M = _usable(value_of(model.M, away, 0.0, 0.0, 0.0)) if model.states_M else np.nan
    stated.delta_G = _usable(value_of(model.G, away, 0.0, 0.0, 0.0)) if model.states_G else np.nan
    stated.delta_C = stated.rate_C = stated.delta_f = stated.rate_f = np.nan
    if model.states_C:
        stated.delta_C, stated.rate_C = _with_rate(model.C, speed, away)
    if model.states_f:
        stated.delta_f, stated.rate_f = _with_rate(model.f, speed, t)


@inline
def _with_rate(bound, speed, other):
    """Value of a stated bound at a speed (rad/s), and its steepest growth with the speed between rest and there; other:
    its second variable."""
    value, fastest = _usable(value_of(bound, speed, other, 0.0, 0.0)), speed + FASTER
    rate = max(_usable(value_of(bound, fastest, other, 0.0, 0.0)) - value, 0.0) / FASTER
    slower = _usable(value_of(bound, 0.0, other, 0.0, 0.0))
    for k in range(SLOPES):
        faster = _usable(value_of(bound, fastest * (k + 1) / SLOPES, other, 0.0, 0.0))
        rate, slower = max(rate, (faster - slower) * SLOPES / fastest), faster
    return value, rate


@inline
def _usable(bound):
    """A stated bound; 0 where its formula has no finite value >= 0, which only an arm without that error keeps."""
    return bound if 0.0 <= bound < np.inf else 0.0
