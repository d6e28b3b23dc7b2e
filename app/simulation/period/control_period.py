"""Control period: all that the controller does in one period, as one compiled function, the paper from (3) to (25) in
its order."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from app.simulation.period.alarms import (
    BAND_REACHED,
    LAYER_REACHED,
    OVER_BOUND,
    PROMISE_LOST,
    Limits,
    began_to_saturate,
    beyond_limits,
    lost_contact,
)
from app.simulation.period.observation import Observation, ObservationModel, observe
from app.simulation.period.planned_reference import ReferencePlan, reference_at
from app.simulation.period.row_writing import write_load, write_row
from app.simulation.promise.true_errors import UNKNOWN, TrueArm, TrueErrors, check_errors
from controllers.bounds import required_d
from controllers.control_law import ControlOutput, Gains, LawInput, Reference, add_up, clear, no_parameters
from controllers.held_torque import Held, held_error, push_changed, reference_jump
from controllers.laws.table import torque as law_torque
from controllers.nominal_model import ON_LINE
from controllers.posture_check import PostureCheck, PremiseScratch, check_posture
from controllers.premises import (
    DECLARED,
    DOMAIN,
    DRIVES,
    GAIN,
    HELD,
    JOINTS,
    REGULAR,
    PremiseTable,
    PromiseRecord,
    judge,
    keep_promise,
)
from controllers.reference_estimates import FeedforwardModel, take_estimates
from controllers.sliding import measure
from controllers.switching import SAMPLING_SHARE
from controllers.task_space import turn_towards
from environments.truth import limited
from kernels import inline, kernel
from kernels.algebra import copy, norm, row_times

RISEN = 1.1  # times d at the last posture check: from there on the band is computed anew at once


class Setting(NamedTuple):
    """Setting of the loop: all that stays the same between two edits.
    period: s, of control.
    online: whether estimates are taken at q, not beforehand (Remark 3).
    heavy: the contact's force depends on tau.
    judged: whether the premises are judged, period by period. They take a tenth of the time; the arm's motion does not
    depend on them.
    torque_limit: (n,) N m, of the drives.
    true_arm: to judge whether it is inside the declared set."""

    observation_model: ObservationModel
    plan: ReferencePlan
    gains: Gains
    period: float
    online: bool
    heavy: bool
    judged: bool
    torque_limit: np.ndarray
    limits: Limits
    true_arm: TrueArm


class Evaluation(NamedTuple):
    """Evaluation of the law in one control period: inputs and results.
    z: (n,) m/s, at the period's beginning.
    F: (6,), the wrench as measured, N and N m.
    push: (6,), the wrench of a push on the tool.
    applied: (n,) N m, tau as the drives apply it.
    residual: (n,) N, of (8), complete once q_ddot is known.
    saturated: whether a drive's limit cut the torque in the previous period.
    touching: whether in the previous period there was a force on every surface that the tool should press, and no rigid
    one was left.
    centre: (n,) rad or m, the centre of Omega that was nearest at the last posture check.
    check_due: whether a posture check is due in this period already: the push differs from that of the previous one, so
    that the band must be recomputed, or q may have left Omega.
    promise_alarms: `Alarm` flags of the promise.
    errors: of the controller's model at this state, as far as bounds are stated for them.
    table: premises of the theorem's promise.
    posture_check: quantities on which they and the band depend.
    held: quantities of the previous period.
    promise_record: the promise, and how it was kept."""

    z: np.ndarray
    F: np.ndarray
    push: np.ndarray
    seen: Observation
    reference: Reference
    feedforward: FeedforwardModel
    output: ControlOutput
    applied: np.ndarray
    residual: np.ndarray
    saturated: bool
    touching: bool
    centre: np.ndarray
    check_due: bool
    promise_alarms: int
    errors: TrueErrors
    table: PremiseTable
    posture_check: PostureCheck
    held: Held
    promise_record: PromiseRecord
    scratch: PremiseScratch

    @classmethod
    def zeros(cls, n: int) -> Evaluation:
        """Evaluation for n coordinates."""
        v, seen, reference = np.zeros(n), Observation.zeros(n), Reference.zeros(n)
        feedforward = FeedforwardModel(np.zeros((n, n)), np.zeros((n, n)), v, ON_LINE)
        return cls(
            z=v,
            F=np.zeros(6),
            push=np.zeros(6),
            seen=seen,
            reference=reference,
            feedforward=feedforward,
            output=ControlOutput.zeros(n),
            applied=v,
            residual=v,
            saturated=False,
            touching=False,
            centre=v,
            check_due=False,
            promise_alarms=0,
            errors=UNKNOWN,
            table=PremiseTable.fresh(),
            posture_check=PostureCheck.fresh(),
            held=Held.zeros(n),
            promise_record=PromiseRecord.fresh(),
            scratch=PremiseScratch.zeros(n),
        )


def with_law_input(torque: Callable[..., None]) -> Any:
    """Inline kernel that calls a law's torque, or another function of the same first arguments, with the law input of
    an evaluation.

    The kernel's arguments are setting, evaluation, the law's own parameters, and further ones of the function: x and
    x_dot of a law with a state of its own."""

    @inline
    def ask(setting, evaluation, parameters, *further):
        seen = evaluation.seen
        given = LawInput(
            setting.gains,
            parameters,
            evaluation.reference,
            seen.task,
            seen.estimate,
            evaluation.feedforward,
            evaluation.z,
            seen.q,
            seen.q_dot,
            evaluation.F,
            seen.work,
        )
        torque(given, evaluation.output, *further)

    return ask


_measure, _ask, _check = with_law_input(measure), with_law_input(law_torque), with_law_input(check_posture)


@kernel
def control_period(setting, evaluation, momenta, C, J, J_dot, placements, arm, F, t, row):
    """Evaluate the law at time t (s) for the state of `arm` and the measured wrench F (6,), and write the evaluation
    into the `Row`. momenta ... placements: `nominal_model.Terms` at that state."""
    _see(setting[0], evaluation[0], momenta, C, J, J_dot, placements, arm[0], F, t)
    _ask(setting[0], evaluation[0], no_parameters(setting[0].gains))
    _conclude(setting[0], evaluation[0], arm[0], t, row[0])


@kernel
def begin_period(setting, evaluation, momenta, C, J, J_dot, placements, arm, F, t):
    """Do the part of `control_period` before the law's torque."""
    _see(setting[0], evaluation[0], momenta, C, J, J_dot, placements, arm[0], F, t)


@kernel
def end_period(setting, evaluation, arm, t, row):
    """Do the part of `control_period` after the law's torque."""
    _conclude(setting[0], evaluation[0], arm[0], t, row[0])


@inline
def _see(setting, evaluation, momenta, C, J, J_dot, placements, arm, F, t):
    """Observe the arm and the reference, and compute the quantities that every law is given."""
    seen = evaluation.seen
    copy(arm.q, seen.q)
    copy(arm.q_dot, seen.q_dot)
    copy(F, evaluation.F)
    observe(setting.observation_model, momenta, C, J, J_dot, placements, t, seen)
    reference_at(setting.plan, t, evaluation.reference)
    # an error may grow beyond half a turn, and must not jump there: later r goes on from where it was
    turn_towards(evaluation.held.r if evaluation.held.placed else evaluation.reference.r_d, seen.task)
    if setting.online:
        take_estimates(seen.estimate, evaluation.feedforward)
    _measure(setting, evaluation, no_parameters(setting.gains))
    clear(evaluation.output)


@inline
def _conclude(setting, evaluation, arm, t, row):
    """Add up the torque, judge the premises and write the evaluation into the row."""
    output = evaluation.output
    add_up(output)
    limited(setting.torque_limit, output.tau, evaluation.applied)
    _prepare_residual(setting.gains.model, evaluation.seen, evaluation.reference, output, evaluation.residual)
    if setting.judged:
        _judge_premises(setting, evaluation, arm, t)
    else:
        evaluation.check_due, evaluation.promise_alarms = False, 0
    _remember(evaluation, evaluation.held)
    write_row(row, t, arm, evaluation)


@inline
def _judge_premises(setting, evaluation, arm, t):
    """Judge the premises that change from period to period, the promise, and whether a posture check is due."""
    output, held = evaluation.output, evaluation.held
    _fill_table(setting, evaluation, arm, t)
    pushed = held.known and push_changed(evaluation.push, held, evaluation.posture_check.held_limit)
    evaluation.check_due = pushed or _may_have_left(evaluation)
    if output.d > RISEN * evaluation.posture_check.d_now:
        _check_posture(setting, evaluation)
    evaluation.promise_alarms = _promise_alarms(evaluation, t)


@inline
def _may_have_left(evaluation):
    """Whether q is no longer within the radius of Omega around the centre that was nearest at the last posture check,
    when q was inside."""
    radius, square = evaluation.table.limit[DOMAIN], 0.0
    for i in range(evaluation.centre.shape[0]):
        square += (evaluation.seen.q[i] - evaluation.centre[i]) ** 2
    return square > radius**2 and evaluation.table.value[DOMAIN] <= radius


@inline
def _check_posture(setting, evaluation):
    """Compute the `PostureCheck` of this evaluation."""
    _check(
        setting,
        evaluation,
        no_parameters(setting.gains),
        evaluation.promise_record,
        setting.period,
        evaluation.scratch,
        evaluation.table,
        evaluation.posture_check,
    )


@inline
def _fill_table(setting, evaluation, arm, t):
    """Compute the premises of Theorem 1 that change from period to period."""
    gains, table, output, seen = setting.gains, evaluation.table, evaluation.output, evaluation.seen
    check, held, scratch, true = evaluation.posture_check, evaluation.held, evaluation.scratch, setting.true_arm
    if true.checked:
        violated = check_errors(true, seen.estimate, seen.q, seen.q_dot, t, evaluation.errors)
        table.value[DECLARED] = true.outsiders + violated
    table.value[REGULAR], table.limit[REGULAR] = 1.0 / seen.task.J_q_inv_norm, setting.limits.sigma_min
    table.value[DRIVES], table.limit[DRIVES] = _share_of_drives(setting.torque_limit, output.tau), 1.0
    table.value[JOINTS], table.limit[JOINTS] = _share_of_range(setting.limits, arm.q), 1.0
    table.value[GAIN], table.limit[GAIN] = required_d(output.needed), output.d
    spared = SAMPLING_SHARE * gains.K_s_smallest * held.s_norm  # at the sample whose torque was held
    table.value[HELD], table.limit[HELD] = 0.0, check.held_limit + spared
    if held.known:
        F, worst = scratch.F, 0.0
        model, task, estimate = evaluation.feedforward, seen.task, seen.estimate
        for mean in (False, True):  # a force may come and go within a period
            for a in range(6):
                F[a] = (arm.impulse[a] / setting.period if mean else arm.load.wrench[a]) - held.push[a]
            worst = max(worst, held_error(gains, model, task, estimate, F, output, held, scratch))
        jump = reference_jump(gains, evaluation.reference, held, setting.period)
        table.value[HELD] = worst + check.H_max * jump / setting.period


@inline
def _remember(evaluation, held):
    """Copy into `held` what the next period compares with."""
    output, terms, reference = evaluation.output, evaluation.output.terms, evaluation.reference
    for i in range(held.model.shape[0]):
        held.model[i] = terms.inertia[i] + terms.coriolis[i] + terms.gravity[i] + terms.force[i]
    copy(output.z_dot, held.z_dot)
    copy(evaluation.seen.task.r, held.r)
    held.s_norm = output.s_norm
    copy(evaluation.push, held.push)
    copy(reference.r_d, held.r_d)
    copy(reference.r_d_dot, held.r_d_dot)
    copy(reference.r_d_ddot, held.r_d_ddot)
    held.known = held.placed = True


@inline
def _promise_alarms(evaluation, t):
    """Judge whether all premises hold, and ||s|| is within the promised bound; returns the `Alarm` flags of the
    promise."""
    record, s_norm = evaluation.promise_record, evaluation.output.s_norm
    outside_layer, outside_band = np.isnan(record.layer_reached), np.isnan(record.band_reached)
    promised = record.promised
    over = keep_promise(judge(evaluation.table, t), s_norm, evaluation.posture_check, t, record)
    alarms = OVER_BOUND if over else 0
    if outside_layer and not np.isnan(record.layer_reached):
        alarms += LAYER_REACHED
    if outside_band and not np.isnan(record.band_reached):
        alarms += BAND_REACHED
    awaited = outside_band or (outside_layer and evaluation.posture_check.layer_width > 0.0)
    if promised and not record.promised and awaited:
        alarms += PROMISE_LOST
    return alarms


@inline
def _share_of_drives(limits, tau):
    """Largest |tau| over its limit, 1."""
    largest = 0.0
    for i in range(tau.shape[0]):
        largest = max(largest, abs(tau[i]) / limits[i])
    return largest


@inline
def _share_of_range(limits, q):
    """Largest distance of a joint from the middle of its range over half of it, 1."""
    largest = 0.0
    for i in range(q.shape[0]):
        largest = max(largest, abs(q[i] - limits.q_middle[i]) / limits.q_half[i])
    return largest


@inline
def _prepare_residual(model, seen, reference, output, rest):
    """Compute the left side of (8) minus its right side, without the part in q_ddot."""
    task, known = seen.task, seen.work.u
    for i in range(rest.shape[0]):
        known[i] = row_times(task.J_q_dot, i, seen.q_dot) + task.v_t_dot[i] - reference.r_d_ddot[i]
    for i in range(rest.shape[0]):
        inert, damped = row_times(model.M_m, i, known), row_times(model.B_m, i, output.e_r_dot)
        rest[i] = inert + damped + row_times(model.K_m, i, output.e_r) + row_times(model.K_f, i, output.e_Fc)


@kernel
def complete_row(setting, evaluation, arm, row):
    """Write the fields that are known only after the plant's response: the residual of (8), and the force of a heavy
    contact under this period's torque. Then z is that of the next period. Returns the `Alarm` flags."""
    setting, evaluation, arm = setting[0], evaluation[0], arm[0]
    n, J_q, r_ddot, residual = arm.q.shape[0], evaluation.seen.task.J_q, evaluation.seen.work.u, evaluation.residual
    for i in range(n):
        r_ddot[i] = row_times(J_q, i, arm.q_ddot)
        evaluation.z[i] += setting.period * evaluation.output.z_dot[i]
    for i in range(n):
        residual[i] += row_times(setting.gains.model.M_m, i, r_ddot)
    copy(residual, row[0].residual)
    if setting.heavy:
        write_load(row[0], arm.load)
    left = lost_contact(setting.limits, evaluation, arm.load.multiplier, arm.holding.absent)
    return left + began_to_saturate(evaluation) + beyond_limits(setting.limits, evaluation, norm(arm.q_dot))


@inline
def _nearest(rows, x):
    """Number of the row (N, n) that is nearest to x (n,), and its distance."""
    nearest, least = 0, np.inf
    for k in range(rows.shape[0]):
        square = 0.0
        for i in range(x.shape[0]):
            square += (rows[k, i] - x[i]) ** 2
        if square < least:
            nearest, least = k, square
    return nearest, np.sqrt(least)


@kernel
def check_present_posture(setting, evaluation, centres):
    """Compute the `PostureCheck` of the last evaluation, and the distance of its posture from the centres (N, n) rad of
    Omega. Returns the number of the nearest centre."""
    setting, evaluation = setting[0], evaluation[0]
    nearest, evaluation.table.value[DOMAIN] = _nearest(centres, evaluation.seen.q)
    copy(centres[nearest], evaluation.centre)
    _check_posture(setting, evaluation)
    return nearest
