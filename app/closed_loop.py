"""The whole program in one function: `ClosedLoop.step` measures, evaluates the law, advances the plant, records."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from app.assembly import System, assemble
from app.control_period import Outcome, Setting, complete_row, control_period, reference_at
from app.recording import Recording
from app.scenario import Scenario
from controllers.bounds import InertiaRange
from controllers.force_loop import force_loop_factor, layer_loop_factor
from controllers.nominal_model import Estimate
from controllers.reaching import ReachingCertificate, sampling_band
from controllers.reference_estimates import EstimateOverride, ReferenceEstimates
from controllers.switching import Switching
from controllers.task_space import TaskSpace
from controllers.vsmrc import LawState, Reference
from environments.held import hold
from environments.plant import PlantState
from environments.sensors import ForceReader, ReaderMemory

SPEED_LIMIT = 20.0  # rad/s, beyond which a run counts as diverging
FORCE_ITERATIONS = 30
DOMAIN_CHECK = 50  # periods between two looks whether q is still in Omega
# a change of one of these begins a new run; everything else takes effect in the running one
RESTARTING = ("mode", "robot", "task_space", "surface", "simulation")


@dataclass(frozen=True)
class View:
    """What there is to draw and read now. q (n,) rad; tool, tool_desired (3,) m, the latter None in joint space;
    force, force_desired (3,) N; live numbers as `app.runner.Snapshot` lists them."""

    q: np.ndarray
    tool: np.ndarray
    tool_desired: np.ndarray | None
    force: np.ndarray
    force_desired: np.ndarray
    live: dict[str, float]


@dataclass(frozen=True)
class LoopState:
    """Where a run stands between two control periods: all that the next ones depend on, nothing that they change, and
    small, so that it can be kept or sent to another process. t, t_0, s_since s; steps counted from t_0; force (3,) N;
    residual (n,) N."""

    scenario: Scenario
    t: float
    t_0: float
    steps: int
    plant: PlantState
    law: LawState
    force: np.ndarray
    residual: np.ndarray
    reader: ReaderMemory
    certificate: ReachingCertificate
    s_since: float
    reaching_time: float | None
    stopped: str | None
    warning: str | None


class ClosedLoop:
    """One run of a scenario: no thread, no screen, no file.

    `stopped` says why the run has ended, None while it goes; `warning` what was only flagged. `reaching_time` (s) is
    None until s is reached. Raises ScenarioError when the scenario cannot be built.
    """

    def __init__(self, scenario: Scenario, history: int = 600_000, previous: System | None = None) -> None:
        self._history = history
        self._begin(assemble(scenario, previous))

    @classmethod
    def resume(cls, state: LoopState, history: int = 600_000, previous: System | None = None) -> ClosedLoop:
        """A run that goes on from `state` exactly as the one that was there; `edit` takes it elsewhere.

        It shares the parts of `previous` that are the same, so the two must not step in different threads.
        """
        loop = cls(state.scenario, history, previous)
        loop.t, loop._t_0, loop._steps = state.t, state.t_0, state.steps
        loop._plant, loop._law = deepcopy((state.plant, state.law))
        loop._force, loop._residual = state.force.copy(), state.residual.copy()
        loop._reader.recall(state.reader)
        loop.certificate, loop.s_since, loop.reaching_time = state.certificate, state.s_since, state.reaching_time
        loop.stopped, loop.warning = state.stopped, state.warning
        loop._set()
        return loop

    def state(self) -> LoopState:
        """To go on from later, elsewhere: see `resume`."""
        return LoopState(
            self.system.scenario, self.t, self._t_0, self._steps, *deepcopy((self._plant, self._law)),
            self._force.copy(), self._residual.copy(), self._reader.memory(), self.certificate, self.s_since,
            self.reaching_time, self.stopped, self.warning,
        )  # fmt: skip

    def _begin(self, system: System) -> None:
        self.system = system
        self.t = 0.0
        self.stopped: str | None = None
        self.recording = Recording(system.layout.n, self._history)
        self._reader = ForceReader(system.sensor, system.scenario.simulation.seed)
        self._plant = system.plant.start(system.robot.posture, np.zeros(system.robot.n), 0.0)
        self._force, self._residual = self._plant.load.force, np.zeros(system.layout.n)
        self._law = LawState(np.zeros(system.layout.n))
        self._take_up(system)

    def edit(self, scenario: Scenario) -> None:
        """Go on with a changed scenario, or begin anew where the change does not allow it.

        Raises ScenarioError, and then the running one goes on.
        """
        old, new = self.system.scenario, assemble(scenario, self.system)
        restarts = any(getattr(old, f) != getattr(scenario, f) for f in RESTARTING)
        restarts |= (old.contact.kind, old.controller.period) != (scenario.contact.kind, scenario.controller.period)
        if restarts or self.stopped:
            self._begin(new)
            return
        if old.sensor != scenario.sensor:
            self._reader = ForceReader(new.sensor, scenario.simulation.seed)
        self._take_up(new)

    def reset(self) -> None:
        """Begin the same scenario anew."""
        self._begin(self.system)

    def step(self) -> None:
        """One control period. Call it only while `stopped` is None."""
        system, plant, t = self.system, self._plant, self.t
        row = self.recording.new_row()

        F = self._reader.read(plant.load.force)
        outcome = self._control(F, row)
        if system.scenario.sensor.ideal and system.plant.heavy:
            outcome = self._with_solved_force(outcome, row)
        self._plant = system.plant.advance(plant, outcome.tau, t, self._period)

        self._complete(row, plant, outcome)
        self._watch(t, outcome)
        self._law = LawState(outcome.z_next)
        self._steps += 1
        self.t = self._t_0 + self._steps * self._period

    def reference(self, t: float) -> Reference:
        """r_d and F_cd with their derivatives at time t (s)."""
        return reference_at(self.system.plan, self.system.motion.evaluate(t), self.system.force.evaluate(t))

    def _control(self, F: np.ndarray, row: np.ndarray) -> Outcome:
        """The law's answer to the present state and the measured force F (3,) N."""
        system, t, q, q_dot = self.system, self.t, self._plant.q, self._plant.q_dot
        override = self._override if self._along is None else self._along.at(q, q_dot, t)
        system.nominal.update(q, q_dot)
        path, force = system.motion.evaluate(t), system.force.evaluate(t)
        return control_period(self._held, override, path, force, self._law.z, q, q_dot, F, t, row)

    def _with_solved_force(self, outcome: Outcome, row: np.ndarray) -> Outcome:
        """The law fed with the force that its own torque causes: secant iteration on the multiplier (DESIGN 4.6)."""
        world, plant, t = self.system.plant, self._plant, self.t
        guess = plant.load.multiplier
        outcome = self._control(world.force_of(plant, guess, t), row)
        error = world.respond(plant, outcome.tau, t).multiplier - guess
        slope = -1.0
        for _ in range(FORCE_ITERATIONS):
            if abs(error) <= 1e-10 * (1.0 + abs(guess)):
                return outcome
            change = -error / slope if slope != 0.0 else error
            guess += change
            outcome = self._control(world.force_of(plant, guess, t), row)
            before, error = error, world.respond(plant, outcome.tau, t).multiplier - guess
            slope = (error - before) / change
        self._left("stop", f"the loop through the multiplier has no solution near {plant.load.multiplier:.4g} N")
        return outcome

    def _take_up(self, system: System) -> None:
        """Go on with this system from the present state; s jumps where gains or references do."""
        self.system = system
        self._period = system.scenario.controller.period
        self._t_0, self._steps = self.t, 0
        self._override = EstimateOverride.none(system.layout.n)
        self._along = self._reference_estimates()
        plant, law = self._plant, system.law
        estimate, task = system.observe(plant.q, plant.q_dot, self.t)
        reference = self.reference(self.t)
        e_r, e_r_dot = task.r - reference.r_d, task.r_dot - reference.r_d_dot
        if system.scenario.controller.on_change == "remove":
            self._law = LawState(law.compensator.without_reaching(e_r, e_r_dot))
        s = e_r_dot + law.compensator.F_1 @ e_r + law.compensator.F_2 @ self._law.z
        H_high = InertiaRange.at(law.uncertainty, estimate, task).H_high
        self.certificate = ReachingCertificate(
            system.constants.k_r_low,
            system.constants.k_r_high,
            float(np.linalg.eigvalsh(law.K_s)[0]),
            law.epsilon * law.switching.kept,
            V_0=float(0.5 * s @ H_high @ s),
        )
        self.warning = self._force_loop_warning(estimate, task)
        self.s_since = self.t
        self.reaching_time: float | None = None
        self._set()

    def _set(self) -> None:
        """Hand the kernel what stays the same until the next edit."""
        system = self.system
        self._held = hold(
            Setting(
                system.nominal.terms, system.nominal.links, system.charted.shape, system.layout, system.plan,
                system.law.gains, self.certificate.promise, self.s_since, self._period,
            )
        )  # fmt: skip

    def _force_loop_factor(self, estimate: Estimate, task: TaskSpace) -> float:
        """See `controllers.force_loop`; nan where no force is fed back through a loop that sampling closes."""
        contact, plant = self.system.scenario.contact, self.system.plant
        if not (self.system.m and plant.heavy):
            return math.nan
        H_hat = task.J_q_inv.T @ estimate.M_hat @ task.J_q_inv
        M_e = math.inf if contact.kind == "rigid" else contact.M_e
        return force_loop_factor(H_hat, H_hat, self.system.law.model, M_e)

    def _force_loop_warning(self, estimate: Estimate, task: TaskSpace) -> str | None:
        factor = self._force_loop_factor(estimate, task)
        if self.system.scenario.sensor.ideal or math.isnan(factor) or abs(factor) < 1.0:
            return None
        return (
            f"the sampled force loop diverges: its factor is {factor:.3g}, allowed: between -1 and 1; "
            "raise M_m1, or set sensor.ideal"
        )

    def _reference_estimates(self) -> ReferenceEstimates | None:
        system = self.system
        if system.scenario.controller.estimates == "online":
            return None
        return ReferenceEstimates(
            system.nominal,
            system.constants.lipschitz,
            lambda q, t: system.posture_at(q, self.reference(t), t),
            system.q_0,
            self._period,
        )

    def _complete(self, row: np.ndarray, before: PlantState, outcome: Outcome) -> None:
        """Record what is known only now that the plant has answered."""
        after = self._plant
        # a heavy contact's force goes with this period's torque
        load = after.load if self.system.plant.heavy else before.load
        self._force = load.force
        self._residual, self._speed = complete_row(
            row,
            outcome.residual_gain,
            outcome.residual_rest,
            after.q_ddot,
            after.q_dot,
            load.force,
            load.multiplier,
            before.load.phi,
        )
        self.recording.commit()

    def _watch(self, t: float, outcome: Outcome) -> None:
        """Has the run left the theorem's domain? Say which way and when; stop, or flag where the user chose so."""
        scenario, plant = self.system.scenario, self._plant
        if self.reaching_time is None and outcome.s_norm <= outcome.s_band:
            self.reaching_time = t - self.s_since
        speed = self._speed
        choice = scenario.simulation.leaving_domain
        if not math.isfinite(speed + outcome.s_norm):
            self._left("stop", "the state is no longer finite: the loop diverged")
        elif scenario.contact.kind == "rigid" and scenario.contact.unilateral and plant.load.multiplier < 0.0 < t:
            self._left("stop", f"contact lost, the surface would have to pull (λ = {plant.load.multiplier:.4g} N)")
        elif outcome.sigma_min < scenario.simulation.sigma_min:
            self._left(choice, f"J_q is nearly singular (σ_min = {outcome.sigma_min:.4g} m)")
        elif speed > SPEED_LIMIT:
            self._left(choice, f"the arm diverges (‖q̇‖ = {speed:.4g} rad/s)")
        elif outcome.s_norm > outcome.s_allowed and scenario.controller.law == "vsmrc":
            self._left(
                scenario.simulation.bound_violation,
                f"‖s‖ = {outcome.s_norm:.4g} m/s is over its bound (20), {outcome.s_allowed:.4g} m/s with the "
                "sampling band",
            )
        elif self._steps % DOMAIN_CHECK == 0 and not self.system.constants.holds_at(plant.q):
            self._left("flag", "q has left Ω, over which the constants of (19) were computed")

    def _left(self, choice: str, reason: str) -> None:
        if choice == "stop":
            self.stopped = f"t = {self.t:.3f} s: {reason}"
        elif self.warning is None:  # what came first explains what follows
            self.warning = f"t = {self.t:.3f} s: {reason}"

    def view(self) -> View:
        """The present state as the screen shows it."""
        system, plant, law, t = self.system, self._plant, self.system.law, self.t
        estimate, task = system.observe(plant.q, plant.q_dot, t)
        reference = self.reference(t)
        deviation = self._override.deviation
        output = law.evaluate(self._law, reference, task, estimate, deviation, plant.q_dot, self._force)
        H_hat = task.J_q_inv.T @ estimate.M_hat @ task.J_q_inv
        live = {
            "s_norm": float(np.linalg.norm(output.s)),
            "s_bound": float(self.certificate.envelope(t - self.s_since)),
            "s_band": sampling_band(
                self.certificate.k_r_low,
                self.certificate.k_r_high,
                law.gains.K_s_largest,
                int(law.switching),
                law.phi,
                output.d,
                law.epsilon,
                self._period,
            ),
            "d": output.d,
            "d_required": float(sum(output.needed)),
            "gain_margin": output.d - float(sum(output.needed)),
            "sigma_min": 1.0 / float(np.linalg.norm(task.J_q_inv, 2)),
            "V": float(0.5 * output.s @ H_hat @ output.s),
            "residual": float(np.linalg.norm(self._residual)),
            "reaching_time_bound": self.certificate.t_r,
            "reaching_time": np.nan if self.reaching_time is None else self.reaching_time,
            "layer_loop_factor": np.nan,
            "force_loop_factor": self._force_loop_factor(estimate, task),
        }
        if law.switching is not Switching.DISCONTINUOUS:
            live["layer_loop_factor"] = layer_loop_factor(H_hat, law.K_s, output.d, law.phi, self._period)
        return View(
            plant.q,
            estimate.p,
            None if system.layout.joint else system.tool_at(reference, t),
            self._force,
            task.normal * reference.F_cd[0] if system.m else np.zeros(3),
            live,
        )
