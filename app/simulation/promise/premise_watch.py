"""Watch of the premises of Theorem 1 in a run: begun anew at every change, updated on the way, and the alarms of each
period."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple, TypeVar

import numpy as np

from app.scenario.errors import UnboundedGain
from app.simulation.omega.domain import covered, without_inertia
from app.simulation.omega.stations import APART, SAME_STATION
from app.simulation.period.alarms import Alarm
from app.simulation.period.controlled_arm import ControlledArm
from app.simulation.promise.failure_sentences import infinity, last_loss, saturation, surface_named
from app.simulation.promise.verdict import sentence
from app.simulation.recording import Epoch
from app.simulation.sampled_loop.sampled_force_loop import worst_gain_by_force
from app.simulation.sampled_loop.sampled_stability import RespondingLoop, SampledLoop, SampledLoops
from app.simulation.state import Flag, JudgedPosture, State, epoch_at
from app.simulation.system import System
from controllers.blend import ModelBlend, blended
from controllers.posture_check import periods_between_checks
from controllers.premises import Premise, PromiseRecord, judge

Loop = TypeVar("Loop", bound=SampledLoop)
SHARE = 0.02  # of a blend, between two judgements of the sampled loops
TURNED, AGAIN = 0.02, 0.1  # rad by which a surface has turned, and s: when they are judged again where one changes
ON_THE_WAY = (0.25, 0.5, 0.75, 1.0)  # shares of a blend that is planned, at which its model is judged


class GainFeedbackShares(NamedTuple):
    """Shares of the gain by (17) that are fed back to it, nan where there is no such loop.
    chatter: by chattering.
    force: by the force on the surface."""

    chatter: float
    force: float


NOT_FED_BACK = GainFeedbackShares(np.nan, np.nan)


class PremiseWatch:
    """Watch of the promise of a run, in the memory of its state's evaluation; it writes into the state's `flagged` and
    `stopped` which premise the run has left, and when.

    system: follows the target model in force during a blend; share: of that blend, 0 without one.
    every: control periods from one posture check to the next.
    near: rad, distance from a centre of Omega within which its station stands for the arm's posture.
    known_until: s, from which instant on Omega does not cover the surfaces any more; infinite where they come back.
    """

    def __init__(self, system: System, state: State, arm: ControlledArm) -> None:
        self.system = system
        self._state, self._arm, self._h = state, arm, system.scenario.controller.period
        self.every = periods_between_checks.py_func(self._h)
        self._stations = system.stations
        self._table = state.evaluation.views.table
        self._sampled: SampledLoop | None = None
        self._loops = SampledLoops(system)
        self.share = 0.0
        stated_in_time = isinstance(system.scenario.declared.delta_f, str)
        self._changing = stated_in_time or any(each.turning for each in system.surfaces)
        self.near = APART if all(each.form.normal_fixed for each in system.surfaces) else SAME_STATION
        always = not system.mode.on_surface or covered(system.surfaces)  # the surfaces that r is about
        self.known_until = np.inf if always else system.constants.omega.span

    def follow(self, system: System, share: float) -> None:
        """Follow a blend of the target model: the system with the model in force, and the share of the blend."""
        self.system, self.share = system, share

    @property
    def model_has_moved(self) -> bool:
        """Whether the target model has moved on in a blend since the sampled loops were judged."""
        return abs(self.share - self._state.judged.share) >= SHARE

    def begin(self) -> None:
        """Begin an epoch: the theorem promises anew, from the present s."""
        state = self._state
        state.epoch, state.steps = epoch_at(self.system, state.t, state.arm, state.evaluation), 0
        self._promise_anew()
        begun = self._arm.evaluated()
        self._arm.check_posture(begun)
        state.evaluation.data["posture_check"] = begun.data["posture_check"]
        found = begun.views.table
        if self._beyond_known:
            found.value[Premise.DOMAIN] = np.inf
        judge.py_func(found, state.t)  # once more: the check has found what the period before it did not know
        self._table.value[:], self._table.limit[:] = found.value, found.limit
        self._table.failing[:] = found.failing
        state.evaluation.data["errors"] = begun.data["errors"]
        if not found.failing.any():
            state.epoch = self._with_instants(state.epoch)

    def _with_instants(self, epoch: Epoch) -> Epoch:
        """The epoch with the instants by which ||s|| is promised to be within the boundary layer and within the
        band."""
        check, certificate = self._state.evaluation.part("posture_check"), epoch.certificate
        band = epoch.t + certificate.time_to(float(np.sqrt(2.0 * check.V_band / check.H_min)))
        falls = check.layer_width > 0.0 and check.radius <= check.layer_width  # V falls down to the layer
        layer = epoch.t + certificate.time_to(check.layer_width) if falls else None
        if not self.system.controller.switching.has_layer:
            layer = band
        return replace(epoch, layer_reached_by=layer, band_reached_by=band)

    def _promise_anew(self) -> None:
        """Forget the promise; the record of how it was kept stays with the run."""
        state, system = self._state, self.system
        evaluation, before = state.evaluation, state.evaluation.part("promise_record")
        evaluation.data["saturated"] = evaluation.data["held"]["known"] = False
        evaluation.data["posture_check"]["V_band"] = 0.0
        anew = PromiseRecord.fresh()._replace(
            reaching=state.epoch.certificate.bound, broken=before.broken, begun=state.t
        )
        evaluation.write("promise_record", anew._replace(periods=before.periods, lost=before.lost))
        self._state_premise(Premise.LAW, float(not system.controller.law.robust), 0.0)
        self._state_premise(Premise.DECLARED, float(len(system.outsiders)), 0.0)
        nearest, distance = system.constants.omega.centre_near(state.arm.views.q)
        self._state_premise(Premise.DOMAIN, distance, system.constants.radius)
        limits, away = self._arm.settings.views.limits, state.arm.views.holding.held[: len(system.surfaces)] == 0
        absent = float(away.sum()) if system.plant.nature.rigid else 0.0
        may_leave = any(each.unilateral for each in system.plant.contacts[: len(system.surfaces)])
        if (system.plant.nature.rigid and (may_leave or absent > 0.0)) or limits.meets.any():
            self._state_premise(Premise.CONTACT, absent, 0.0)
        state.judged = JudgedPosture(None, np.full(system.robot.n, np.nan), state.t, self.share)
        self.judge_posture(nearest)

    def _state_premise(self, premise: Premise, value: float, limit: float) -> None:
        """Set the value of a premise that the compiled period does not compute; one with a value of nan does not
        apply."""
        table = self._table
        table.value[premise], table.limit[premise] = value, np.nan if np.isnan(value) else limit

    def check_posture(self) -> None:
        """Judge the premises that depend on the arm's posture."""
        self.judge_posture(self._arm.check_posture(self._state.evaluation))

    @property
    def judged_station(self) -> int:
        """Station along the reference where the sampled loops were judged last, -1 where they are to be judged anew at
        the next posture check wherever the arm is."""
        station = self._state.judged.station
        return -1 if station is None or self.model_has_moved or self._changing else station

    def judge_posture(self, nearest: int) -> None:
        """Flag the run when q has left Omega, and judge the sampled loops when the arm or the target model has moved:
        near the reference at a station, off the reference, and on surfaces that change, at the present posture.
        nearest: number of the nearest centre of Omega."""
        state, distance = self._state, self._table.value[Premise.DOMAIN]
        if distance > self.system.constants.radius:
            self.leave_domain("flag", f"q has left Ω, over which the constants of (19) were computed{self._outlasted}")
        if self._beyond_known:
            self._table.value[Premise.DOMAIN] = np.inf
            self.leave_domain("flag", self._sentence(Premise.DOMAIN, np.inf, self.system.constants.radius))
        station, judged, q = int(self._stations.of[nearest]), state.judged, state.arm.views.q
        if distance > self.near or self._changing:
            moved = judged.station is not None or not np.abs(q - judged.q).max() <= self.near
            if not (moved or self.model_has_moved or self._changed_since(judged)):
                return
            state.judged = JudgedPosture(None, q.copy(), state.t, self.share)
        elif station == judged.station and not self.model_has_moved:
            return
        else:
            at = self._stations.q[station], float(self._stations.t[station])
            state.judged = JudgedPosture(station, *at, self.share)
        self._sampled = None
        for premise, value in self._judged_loop.premises.items():
            self._state_premise(premise, value, 1.0)
            if value > 1.0:
                self.leave_domain("flag", self._sentence(premise, value, 1.0) + self._unsampled)

    def _sentence(self, premise: Premise, value: float, limit: float) -> str:
        return sentence(premise, value, limit, self.system.units, self.system.controller.law)

    @property
    def _beyond_known(self) -> bool:
        """Whether the surfaces are somewhere that Omega does not cover."""
        return self._state.t > self.known_until + 0.5 * self._h

    def _changed_since(self, judged: JudgedPosture) -> bool:
        """Whether a surface has turned, or may have changed otherwise, since the sampled loops were judged."""
        if not self._changing:
            return False
        p, t = self._state.evaluation.part("seen").estimate.p, self._state.t
        for surface in self.system.surfaces:
            before, now = (surface.chart(p, at).G[0] for at in (judged.t, t))
            if before @ now < np.cos(TURNED) * np.linalg.norm(before) * np.linalg.norm(now):
                return True
        return t - judged.t >= AGAIN

    @property
    def _unsampled(self) -> str:
        """Suffix where the target model itself is unstable on the true surfaces; else ""."""
        poles = np.real(self.sampled.model)
        if not poles.size or poles.max() < 0.0:
            return ""
        return f"; the target model itself is unstable against the true stiffness (a pole at {poles.max():.3g} 1/s)"

    @property
    def _outlasted(self) -> str:
        """Suffix for a run that outlasts `simulation.duration`, for which Omega was computed; else ""."""
        duration = self.system.scenario.simulation.duration
        if self._state.t <= duration:
            return ""
        whole = "a path that goes on to other places needs a scenario with a longer duration (simulation.duration)"
        return f" for the first {duration:g} s of the path; {whole}"

    @property
    def sampled(self) -> RespondingLoop:
        """The sampled loop as it was judged last, with its responses."""
        loop, judged = self._judged_loop, self._state.judged
        if not isinstance(loop, RespondingLoop):
            loop = self._remembered(judged, self._loops_of_system.responding(loop, judged.q, judged.t))
        return loop

    @property
    def _judged_loop(self) -> SampledLoop:
        """The sampled loop as it was judged last."""
        judged, known = self._state.judged, self.system.sampled_loops
        if self._sampled is None and judged.station in known:
            self._sampled = known[judged.station]
        return self._sampled or self._remembered(judged, self._loops_of_system.at(judged.q, judged.t))

    @property
    def _loops_of_system(self) -> SampledLoops:
        if self._loops.system is not self.system:
            self._loops = SampledLoops(self.system)
        return self._loops

    def _remembered(self, judged: JudgedPosture, loop: Loop) -> Loop:
        """Keep the sampled loop of the posture that was judged last; that of a station is kept for other runs, too."""
        self._sampled = loop
        if judged.station is not None:
            self.system.sampled_loops[judged.station] = loop
        return loop

    @property
    def fed_back(self) -> GainFeedbackShares:
        """Feedback of the gain by (17) at present."""
        value, limit = self._table.value, self._table.limit
        chatter = np.nan if np.isnan(limit[Premise.GAIN_BY_CHATTER]) else float(value[Premise.GAIN_BY_CHATTER])
        return GainFeedbackShares(chatter, float(value[Premise.GAIN_BY_FORCE]))

    def require_bounded_gain(self, before: GainFeedbackShares) -> None:
        """Raise UnboundedGain where the gain by (17) feeds itself: it would grow without bound whatever else is
        chosen. before: the feedback before the change; only an increase is refused."""
        chatter, force = (0.0 if now <= earlier else now for now, earlier in zip(self.fed_back, before, strict=True))
        self._require_bounded(chatter, force, f"controller.bounds: with {self.system.controller.bounds!r}")

    def require_bounded_blend(self, blend: ModelBlend | None) -> None:
        """Raise UnboundedGain where the gain by (17) would feed itself with a model on the way of this blend."""
        controller = self.system.controller
        if blend is None or not controller.law.robust or controller.d is not None:
            return
        q, t = self._state.arm.views.q, self._state.t
        check = self._state.evaluation.part("posture_check")
        lead = f"blend.to: on the way to this target model, with controller.bounds {controller.bounds!r},"
        for share in ON_THE_WAY:
            following = controller.following(blended(blend.start, blend.end, share))
            chatter = check.growth_by_speed + check.growth_by_damping * following.gains.damping_rate
            force = worst_gain_by_force(self.system.with_controller(following), q, t)
            self._require_bounded(chatter, force, lead)

    def _require_bounded(self, chatter: float, force: float, lead: str) -> None:
        """Raise UnboundedGain where a share that is fed back is 1 or more. lead: beginning of the sentence."""
        controller = self.system.controller
        if not controller.law.robust or controller.d is not None:
            return
        if chatter == np.inf:
            stated = self.system.scenario.declared.delta_M is not None
            declared = "declared.delta_M" if stated else without_inertia(controller.uncertainty)
            raise UnboundedGain(
                f"{declared}: the bound E of the declared errors leaves no inertia at this posture "
                "(M̂ - E is not positive definite), so no gain by (17) suffices; allowed: a smaller value"
            )
        others = "controller.bounds = 'tight', " if controller.bounds == "paper" else ""
        others += f"controller.gain = 'constant', or a smaller {self._declared_bound()}"
        if chatter >= 1.0:
            raise UnboundedGain(
                f"{lead} the gain (17) runs away at this control period: "
                f"chattering feeds {chatter:.3g} of it back ((δ_H ‖M_m⁻¹B_m + A‖ + k_q̇) T / λ_min(H), must be below "
                f"1); allowed: controller.period <= {0.95 * self._h / chatter:.2g} s, {others}"
            )
        if force >= 1.0:
            raise UnboundedGain(
                f"{lead} the gain (17) and the force on the surface raise each other: {force:.3g} of each change "
                f"comes back (must be below 1), and no control period helps; allowed: {others}"
            )

    def _declared_bound(self) -> str:
        """Dotted path of the declared bound from which most of the growth of (17) with s follows, the first one of
        several."""
        declared, check = self.system.scenario.declared, self._state.evaluation.part("posture_check")
        if check.growth_by_speed > 0.5 * self._table.value[Premise.GAIN_BY_CHATTER]:
            stated = "declared.delta_f" if declared.delta_f is not None else "declared.viscous"
            return stated if declared.delta_f is not None or declared.viscous > 0.0 else "declared.delta_C"
        if declared.delta_M is not None:
            return "declared.delta_M"
        links = ("link_scaling", "rotor_scaling", "link_centre", "link_shape", "payload_mass")
        return f"declared.{next((name for name in links if getattr(declared, name) > 0.0), links[0])}"

    @property
    def band_reached(self) -> float | None:
        """Instant at which ||s|| was first within its band since the last change, s; None while it has not been."""
        reached = self._state.evaluation.part("promise_record").band_reached
        return None if np.isnan(reached) else reached

    @property
    def layer_reached(self) -> float | None:
        """Instant at which ||s|| was first within the boundary layer, or within the band for a law that has no layer,
        since the last change, s; None while it has not been."""
        if not self.system.controller.switching.has_layer:
            return self.band_reached
        reached = self._state.evaluation.part("promise_record").layer_reached
        return None if np.isnan(reached) else reached

    def handle(self, alarms: Alarm) -> None:
        """Handle the alarms of a period: note how and when the run has left the theorem's domain; stop it, or flag
        where the user chose so."""
        state, rules = self._state, self.system.scenario.simulation
        evaluation, arm = state.evaluation.read(), state.arm.read()
        if Alarm.LAYER_REACHED in alarms or Alarm.BAND_REACHED in alarms:
            state.epoch = replace(state.epoch, layer_reached=self.layer_reached, band_reached=self.band_reached)
        if Alarm.PROMISE_LOST in alarms:  # what was promised for later is so no more
            layer, band = state.epoch.layer_reached, state.epoch.band_reached
            state.epoch = replace(
                state.epoch,
                layer_reached_by=None if layer is None else state.epoch.layer_reached_by,
                band_reached_by=None if band is None else state.epoch.band_reached_by,
            )
        rigid = self.system.plant.nature.rigid
        if Alarm.CONTACT_LOST in alarms and not rigid:
            left = surface_named(self.system, int(np.argmin(arm.load.multiplier[: self.system.pressed] != 0.0)))
            self.leave_domain("flag", f"contact lost: the tool has left {left}, so its force is not controlled")
        if Alarm.SATURATED in alarms and Alarm.NOT_FINITE not in alarms:
            self.leave_domain("flag", saturation(evaluation.output.tau, evaluation.applied, self.system.robot.slides))
        if Alarm.NOT_FINITE in alarms:
            self.leave_domain("stop", infinity(evaluation, self.system.units))
            return
        if Alarm.CONTACT_LOST in alarms and rigid and evaluation.table.value[Premise.CONTACT] > 0.0:
            self.leave_domain(rules.leaving_domain, f"contact lost, {last_loss(self.system, arm.holding)}")
        if Alarm.SINGULAR in alarms:
            unit = self.system.units.jacobian.removesuffix("1")
            sigma_min = f"{1.0 / evaluation.seen.task.J_q_inv_norm:.4g} {unit}".rstrip()
            self.leave_domain(rules.leaving_domain, f"J_q is nearly singular (σ_min = {sigma_min})")
        elif Alarm.DIVERGING in alarms:
            speed = self.system.units.with_unit(float(np.linalg.norm(arm.q_dot)), "rad/s")
            self.leave_domain(rules.leaving_domain, f"the arm diverges (‖q̇‖ = {speed})")
        if Alarm.OVER_BOUND in alarms:
            rate, promise = self.system.units.rate, evaluation.promise_record
            self.leave_domain(
                rules.bound_violation,
                f"‖s‖ = {1e3 * evaluation.output.s_norm:.4g} {rate} is over (20) plus the band of sampling and layer, "
                f"{1e3 * (promise.bound + promise.band):.4g} {rate}, though all premises hold",
            )

    def leave_domain(self, action: Literal["stop", "flag"], reason: str) -> None:
        """Stop or flag the run, which has left the theorem's domain; the first reason explains the later ones."""
        state = self._state
        if action == "stop":
            state.stopped = state.stopped or f"t = {state.t:.3f} s: {reason}"
        else:
            state.flagged = state.flagged or Flag(state.t, reason)
