"""Standing of a run: the premises of the theorem and the verdict on it, from a system and a state."""

from __future__ import annotations

from app.simulation.promise.failure_sentences import losses
from app.simulation.promise.true_errors import beyond
from app.simulation.promise.verdict import Standing
from app.simulation.state import State
from app.simulation.system import System


def standing_of(system: System, state: State) -> Standing:
    """The premises of the theorem and the verdict on a run in this state."""
    evaluation = state.evaluation
    table, record = evaluation.part("table"), evaluation.part("promise_record")
    stated, errors = evaluation.part("seen").estimate.stated, evaluation.part("errors")
    outsiders = system.outsiders + beyond(errors, stated, system.scenario.declared.least_inertia, system.units)
    lost = losses(system, state.arm.views.holding)
    law = system.controller.law
    return Standing(table, record, state.stopped, outsiders, system.units, law, lost, waiting=state.steps == 0)
