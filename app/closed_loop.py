"""The whole program in one function: `ClosedLoop.step` measures, evaluates the law, advances the plant, records."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from app.assembly import System, assemble
from app.recording import Recording
from app.scenario import Scenario
from controllers.bounds import InertiaRange
from controllers.nominal_model import ON_LINE, Estimate
from controllers.reaching import ReachingCertificate, sampling_band
from controllers.force_loop import force_loop_factor, layer_loop_factor
from controllers.reference_estimates import ReferenceEstimates
from controllers.switching import Switching
from controllers.task_space import TaskSpace
from controllers.vsmrc import ControlOutput, LawState, Reference
from environments.plant import PlantState
from environments.sensors import ForceReader

SPEED_LIMIT = 20.0  # rad/s, beyond which a run counts as diverging
FORCE_ITERATIONS = 30
# a change of one of these begins a new run; everything else takes effect in the running one
RESTARTING = ("mode", "robot", "task_space", "surface", "simulation")


@dataclass(frozen=True)
class Instant:
    """What one step saw and did: the inputs and the output of the law at time t (s)."""

    t: float
    plant: PlantState
    estimate: Estimate
    task: TaskSpace
    reference: Reference
    force: np.ndarray
    output: ControlOutput


@njit(cache=True)
def _reference(t_start, path, rate, acceleration, f, f_rate, f_acceleration, compliance, m, n):
    """r_d(t) = start + path with r_fd = f_nd / K_e_hat (33) in the first m coordinates; F_cd = f_nd there."""
    r_d, r_d_dot, r_d_ddot, F_cd = t_start + path, rate.copy(), acceleration.copy(), np.zeros(n)
    for i in range(m):
        r_d[i], r_d_dot[i], r_d_ddot[i] = compliance * f, compliance * f_rate, compliance * f_acceleration
        F_cd[i] = f
    return Reference(r_d, r_d_dot, r_d_ddot, F_cd)


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


class ClosedLoop:
    """One run of a scenario: no thread, no screen, no file.

    Raises ScenarioError when the scenario cannot be built. `stopped` says why the run has ended, None while it goes.
    """

    def __init__(self, scenario: Scenario, history: int = 600_000) -> None:
        self._history = history
        self._begin(assemble(scenario))

    def _begin(self, system: System) -> None:
        self.system = system
        self.t = 0.0
        self.stopped: str | None = None
        self.warning: str | None = None
        self.recording = Recording(system.layout.n, self._history)
        self._reader = ForceReader(system.sensor, system.scenario.simulation.seed)
        self._plant_state = system.plant.start(system.robot.posture, np.zeros(system.robot.n), 0.0)
        _, task = system.observe(self._plant_state.q, self._plant_state.q_dot, 0.0)
        self._r_start = task.r.copy()
        self._last_force, self._residual_norm = self._plant_state.force, 0.0
        self._law_state = LawState(np.zeros(system.layout.n))
        self._along_reference = self._reference_estimates()
        self._restart_compensator(remove_reaching=system.scenario.controller.on_change == "remove")

    def edit(self, scenario: Scenario) -> None:
        """Go on with a changed scenario, or begin anew where the change does not allow it.

        Raises ScenarioError, and then the running one goes on.
        """
        old = self.system.scenario
        new = assemble(scenario, self.system)
        restarts = any(getattr(old, f) != getattr(scenario, f) for f in RESTARTING)
        restarts |= (old.contact.kind, old.controller.period) != (scenario.contact.kind, scenario.controller.period)
        if restarts or self.stopped:
            self._begin(new)
            return
        self.system = new
        if old.sensor != scenario.sensor:
            self._reader = ForceReader(new.sensor, scenario.simulation.seed)
        self._along_reference = self._reference_estimates()
        shaping = ("target_model", "controller", "force", "motion")
        if any(getattr(old, f) != getattr(scenario, f) for f in shaping):
            self._restart_compensator(remove_reaching=scenario.controller.on_change == "remove", keep=True)

    def reset(self) -> None:
        """Begin the same scenario anew."""
        self._begin(self.system)

    def step(self) -> Instant:
        """One control period. Call it only while `stopped` is None."""
        system, t, plant = self.system, self.t, self._plant_state
        period = system.scenario.controller.period

        estimate, task = system.observe(plant.q, plant.q_dot, t)
        reference = self.reference(t)
        force = self._reader.read(plant.force)
        output = self._law(estimate, task, reference, plant, force, t)
        if system.scenario.sensor.ideal and system.scenario.contact.kind in ("rigid", "mass-damper-spring"):
            force, output = self._solved_force_loop(estimate, task, reference, plant, output, t)
        self._plant_state = system.plant.advance(plant, output.tau, t, period)

        instant = Instant(t, plant, estimate, task, reference, force, output)
        self._record(instant)
        self._law_state = system.law.next(output, period)
        self._steps += 1
        self.t = self._t_period + self._steps * period
        return instant

    def reference(self, t: float) -> Reference:
        """r_d and F_cd with their derivatives at time t (s)."""
        system = self.system
        path, force = system.motion.evaluate(t), system.force.evaluate(t)
        return _reference(self._r_start, *path, *force, system.compliance, system.m, system.layout.n)

    def view(self) -> View:
        """The present state as the screen shows it."""
        system, plant, law = self.system, self._plant_state, self.system.law
        estimate, task = system.observe(plant.q, plant.q_dot, self.t)
        reference = self.reference(self.t)
        force = self._last_force
        output = self._law(estimate, task, reference, plant, force, self.t)
        H_hat = task.J_q_inv.T @ estimate.M_hat @ task.J_q_inv
        contact, needed = system.scenario.contact, sum(output.needed)
        s_norm = float(np.linalg.norm(output.s))
        live = {
            "s_norm": s_norm,
            "s_bound": float(self.certificate.envelope(self.t - self.s_since)),
            "s_band": self._band(output.d),
            "d": output.d,
            "d_required": needed,
            "gain_margin": output.d - needed,
            "sigma_min": 1.0 / float(np.linalg.norm(task.J_q_inv, 2)),
            "V": float(0.5 * output.s @ H_hat @ output.s),
            "residual": self._residual_norm,
            "reaching_time_bound": self.certificate.t_r,
            "reaching_time": np.nan if self.reaching_time is None else self.reaching_time,
            "layer_loop_factor": np.nan
            if law.switching is Switching.DISCONTINUOUS
            else layer_loop_factor(H_hat, law.K_s, output.d, law.phi, system.scenario.controller.period),
            "force_loop_factor": force_loop_factor(
                H_hat, H_hat, law.model, np.inf if contact.kind == "rigid" else contact.M_e
            )
            if system.m and contact.kind in ("rigid", "mass-damper-spring")
            else np.nan,
        }
        tool_desired = None
        if system.layout.kind == "cartesian":
            g = np.zeros(3)
            g[: system.layout.positions] = reference.r_d[: system.layout.positions]
            if system.layout.positions == 2:
                g[2] = system.charted.chart(estimate.p, self.t).g[2]
            tool_desired = system.charted.point(g, self.t)
        normal = task.normal * reference.F_cd[0] if system.m else np.zeros(3)
        return View(plant.q, estimate.p, tool_desired, force, normal, live)

    def _band(self, d: float) -> float:
        c, law = self.certificate, self.system.law
        period = self.system.scenario.controller.period
        return sampling_band(
            c.k_r_low, c.k_r_high, self._lambda_max_K_s, int(law.switching), law.phi, d, law.epsilon, period
        )

    def _law(
        self,
        estimate: Estimate,
        task: TaskSpace,
        reference: Reference,
        plant: PlantState,
        force: np.ndarray,
        t: float,
    ) -> ControlOutput:
        deviation = ON_LINE
        if self._along_reference is not None:
            estimate, deviation = self._along_reference.replace(estimate, plant.q, plant.q_dot, t)
        return self.system.law.evaluate(self._law_state, reference, task, estimate, deviation, plant.q_dot, force)

    def _solved_force_loop(
        self,
        estimate: Estimate,
        task: TaskSpace,
        reference: Reference,
        plant: PlantState,
        first: ControlOutput,
        t: float,
    ) -> tuple[np.ndarray, ControlOutput]:
        """The force that the law's own torque causes: secant iteration on the multiplier (DESIGN 4.6)."""
        force, output = plant.force, first
        guess, answer = plant.multiplier, self.system.plant.respond(plant, first.tau, t)
        previous: tuple[float, float] | None = None
        for _ in range(FORCE_ITERATIONS):
            error = answer.multiplier - guess
            if abs(error) <= 1e-10 * (1.0 + abs(guess)):
                return force, output
            slope = -1.0 if previous is None else (error - previous[1]) / (guess - previous[0])
            previous = (guess, error)
            guess = guess - error / slope if slope != 0.0 else guess + error
            force = self.system.plant.force_of(plant, guess, t)
            output = self._law(estimate, task, reference, plant, force, t)
            answer = self.system.plant.respond(plant, output.tau, t)
        self.stopped = f"t = {t:.3f} s: the loop through the multiplier has no solution near {plant.multiplier:.4g} N"
        return force, output

    def _restart_compensator(self, *, remove_reaching: bool, keep: bool = False) -> None:
        """s jumps where gains or references do: set z anew (Remark 2) or watch s being reached again."""
        system, plant = self.system, self._plant_state
        estimate, task = system.observe(plant.q, plant.q_dot, self.t)
        reference = self.reference(self.t)
        e_r, e_r_dot = task.r - reference.r_d, task.r_dot - reference.r_d_dot
        if remove_reaching or not keep:
            self._law_state = system.law.init(e_r, e_r_dot, remove_reaching=remove_reaching)
        compensator = system.law.compensator
        s = e_r_dot + compensator.F_1 @ e_r + compensator.F_2 @ self._law_state.z
        H_high = InertiaRange.at(system.law.uncertainty, estimate, task).H_high
        K_s = np.linalg.eigvalsh(system.law.K_s)
        self._lambda_max_K_s = float(K_s[-1])
        self.certificate = ReachingCertificate(
            system.constants.k_r_low,
            system.constants.k_r_high,
            float(K_s[0]),
            system.law.epsilon * system.law.switching.kept,
            V_0=float(0.5 * s @ H_high @ s),
        )
        self.reaching_time: float | None = None
        self.s_since = self._t_period = self.t
        self._steps = 0

    def _reference_estimates(self) -> ReferenceEstimates | None:
        system = self.system
        if system.scenario.controller.estimates == "online":
            return None

        def posture_along_reference(q: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
            reference = self.reference(t)
            for _ in range(3):
                _, task = system.observe(q, np.zeros_like(q), t)
                q = q + task.J_q_inv @ (reference.r_d - task.r)
            _, task = system.observe(q, np.zeros_like(q), t)
            return q, task.J_q_inv @ (reference.r_d_dot - task.v_t)

        return ReferenceEstimates(
            system.nominal,
            system.constants.lipschitz,
            posture_along_reference,
            system.q_0,
            system.scenario.controller.period,
        )

    def _record(self, at: Instant) -> None:
        system, output, law = self.system, at.output, self.system.law
        after = self._plant_state
        rigid = system.scenario.contact.kind in ("rigid", "mass-damper-spring")
        true = after if rigid else at.plant  # there the force depends on this period's torque
        r_ddot = at.task.J_q @ after.q_ddot + at.task.J_q_dot @ at.plant.q_dot + at.task.v_t_dot
        residual = law.model.residual(
            output.e_r, output.e_r_dot, r_ddot - at.reference.r_d_ddot, output.e_Fc
        )
        self._last_force, self._residual_norm = true.force, float(np.linalg.norm(residual))
        s_norm = float(np.sqrt(output.s @ output.s))
        bound = float(self.certificate.envelope(at.t - self.s_since))
        band = self._band(output.d)
        sigma_min = 1.0 / float(np.linalg.norm(at.task.J_q_inv, 2))
        terms = output.terms
        self.recording.append(
            (
                np.array([at.t]), at.plant.q, at.plant.q_dot, at.task.r, at.task.r_dot, at.reference.r_d,
                output.e_r, output.e_r_dot, at.estimate.p, at.force, true.force, output.F_c, at.reference.F_cd,
                output.z, output.s, terms.inertia, terms.coriolis, terms.gravity, terms.force, terms.linear,
                terms.switching, output.tau, np.array(output.needed), residual,
                np.array([output.d, s_norm, bound, band, sigma_min, true.multiplier, at.plant.phi]),
            )
        )  # fmt: skip
        if self.reaching_time is None and s_norm <= band:
            self.reaching_time = at.t - self.s_since
        self._watch(at, s_norm, bound + band, sigma_min, after)

    def _watch(self, at: Instant, s_norm: float, s_allowed: float, sigma_min: float, after: PlantState) -> None:
        """Has the run left the theorem's domain? Say which way and when; stop, or flag where the user chose so."""
        simulation, contact = self.system.scenario.simulation, self.system.scenario.contact
        when = f"t = {at.t:.3f} s: "
        speed = float(np.sqrt(after.q_dot @ after.q_dot))
        if not np.isfinite(speed) or not np.isfinite(at.output.tau).all():
            self.stopped = when + "the state is no longer finite: the loop diverged"
        elif contact.kind == "rigid" and contact.unilateral and after.multiplier < 0.0 < at.t:
            self.stopped = when + f"contact lost, the surface would have to pull (λ = {after.multiplier:.4g} N)"
        elif sigma_min < simulation.sigma_min:
            self._left(simulation.leaving_domain, when + f"J_q is nearly singular (σ_min = {sigma_min:.4g} m)")
        elif speed > SPEED_LIMIT:
            self._left(simulation.leaving_domain, when + f"the arm diverges (‖q̇‖ = {speed:.4g} rad/s)")
        elif s_norm > s_allowed and at.output.d > 0.0:
            self._left(
                simulation.bound_violation,
                when + f"‖s‖ = {s_norm:.4g} m/s is over its bound (20), {s_allowed:.4g} m/s with the sampling band",
            )

    def _left(self, choice: str, reason: str) -> None:
        if choice == "stop":
            self.stopped = reason
        else:
            self.warning = reason
