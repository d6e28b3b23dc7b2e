"""Runs that the paper's closed forms predict, and what was measured in them: (29), (35)-(37), Remark 2, (26), (42)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.linalg import expm
from scipy.optimize import curve_fit

from app.scenario.data import edited, from_plain, shipped, to_plain
from app.scenario.schema import ControllerSection, Scenario
from app.session.headless_run import simulate
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.system import System

K_E = 10_000.0  # N/m, of the surface in (35)-(37)
DEPTH = 0.004  # m, of the tool in the surface at the start
INERTIA = 10.0  # kg, M_m

Reading = Literal["solved", "one period late"]  # of the multiplier


def changed(scenario: Scenario, **sections: Mapping[str, Any]) -> Scenario:
    """The scenario with fields of some sections replaced; trajectories and surfaces are replaced as a whole. Raises
    ScenarioError."""
    data = to_plain(scenario)
    for name, fields in sections.items():
        data[name] = fields if name in ("motion", "force", "surface") else data[name] | fields
    return from_plain(data)


def certain(scenario: Scenario) -> Scenario:
    """The scenario with a true arm that the controller knows exactly."""
    return changed(scenario, truth={"link_scaling": 1.0}, declared={"link_scaling": 0.0})


@dataclass(frozen=True)
class SteadyState:
    """Steady state at the end of a run, and its prediction by (37).
    ratio: K_e_hat / K_e.
    f_nd: N.
    e_rf, e_fn: normal errors, m and N.
    e_rf_expected, e_fn_expected: these errors by (37)."""

    robot: str
    K_m1: float
    ratio: float
    f_nd: float
    e_rf: float
    e_fn: float
    e_rf_expected: float
    e_fn_expected: float


@dataclass(frozen=True)
class Response:
    """Response of a tool on a mass M_e (kg), damper and spring.
    period: of the control, s.
    phi: penetration (N,) m over t (N,) s.
    exact: this penetration by (29)."""

    M_e: float
    period: float
    t: np.ndarray
    phi: np.ndarray
    exact: np.ndarray

    @property
    def error(self) -> float:
        """Largest error, m."""
        return float(np.abs(self.phi - self.exact).max())


@dataclass(frozen=True)
class MeasuredStart:
    """Start of a shipped scenario.
    choice: `controller.on_change`: "remove" for z(0) of Remark 2, "watch" for z(0) = 0.
    s_0: ||s(0)||, m/s.
    largest: largest ||s|| over the sampling band.
    reached: instant at which the band was reached, s, nan for never."""

    name: str
    choice: str
    s_0: float
    largest: float
    reached: float


@dataclass(frozen=True)
class MeasuredOscillation:
    """Oscillation with prescribed omega (rad/s) and zeta.
    scale: of the usual control period and boundary layer.
    error: (N,) m over t (N,) s, in which the oscillation is seen."""

    kind: str
    scale: float
    omega: float
    zeta: float
    t: np.ndarray
    error: np.ndarray

    @property
    def found(self) -> tuple[float, float]:
        """Omega (rad/s) and zeta measured in the error."""
        return recovered(self.t, self.error)


@dataclass(frozen=True)
class MeasuredForceLoop:
    """Force loop on a rigid surface.
    factor: predicted, of the sampled loop from one control period to the next.
    error: lambda - lambda_d (N,) N in successive periods."""

    M_m1: float
    factor: float
    error: np.ndarray

    @property
    def found(self) -> float:
        """Factor measured in the error, by least squares."""
        return float(self.error[1:] @ self.error[:-1] / (self.error[:-1] @ self.error[:-1]))


@dataclass(frozen=True)
class Multiplier:
    """Errors of the multiplier under a sinusoidal lambda_d, after the start.
    period: of the control, s.
    error: largest |lambda - lambda_d|, N.
    phi: largest |phi|, m."""

    reading: Reading
    period: float
    error: float
    phi: float


def steady(robot: str, K_m1: float, cases: Sequence[tuple[float, float]]) -> list[SteadyState]:
    """Steady states of a pressing arm that is 15 % heavier than believed. cases: (K_e_hat / K_e, f_nd) of each."""
    found: list[SteadyState] = []
    previous: System | None = None
    n = 3 if robot == "planar3r" else 6
    for ratio, f_nd in cases:
        K_e_hat = ratio * K_E
        scenario = changed(
            shipped()[f"{robot}-hybrid"],
            motion={"kind": "hold"},
            force={"kind": "constant", "value": f_nd},
            contact={"K_e": K_E},
            target_model={"K_m": [K_m1] + [4000.0] * (n - 1), "B_m": [700.0] + [400.0] * (n - 1)},
            controller={"K_e_hat": K_e_hat},
            simulation={"duration": 2.5},
        )
        loop, _ = simulate(scenario, previous=previous)
        previous, last = loop.system, loop.recording.at(loop.t)
        e_rf = -(K_E - K_e_hat) / (K_m1 + K_E) / K_e_hat * f_nd
        e_fn = (1.0 - K_E / (K_m1 + K_E)) * (K_E - K_e_hat) / K_e_hat * f_nd
        measured = float(last["e_r"][0]), float(last["multiplier"][0] - f_nd)
        found.append(SteadyState(robot, K_m1, ratio, f_nd, *measured, e_rf, e_fn))
    return found


def pressed(M_e: float, period: float) -> Response:
    """Response of a tool on a bilateral mass-damper-spring that starts away from its equilibrium, with a known arm."""
    base = certain(shipped()["ur5-impedance"])
    M_m, B_m, K_m, B_e, K_e = INERTIA, 60.0, 800.0, 30.0, 3000.0
    height = ClosedLoop.from_scenario(base).view().tool[2].item() + DEPTH
    scenario = changed(
        base,
        target_model={"M_m": [M_m] * 6, "B_m": [B_m] * 6, "K_m": [K_m] * 6},
        surface={"kind": "plane", "origin": [0.0, 0.0, height]},
        contact={
            "kind": "mass-damper-spring" if M_e else "elastic", "M_e": M_e, "B_e": B_e, "K_e": K_e, "unilateral": False,
        },
        sensor={"ideal": True},
        controller={"period": period, "epsilon": 1.0, "layer": 0.02},
        motion={"kind": "hold"},
        simulation={"duration": 0.6},
    )  # fmt: skip
    loop, _ = simulate(scenario)
    record = loop.recording.signals(("t", "phi"))
    # with y = phi: (M_m + M_e) y'' + (B_m + B_e) y' + (K_m + K_e) y = K_m y_d, the tool starts at rest at y_d
    M, B, K = M_m + M_e, B_m + B_e, K_m + K_e
    A = np.array([[0.0, 1.0], [-K / M, -B / M]])
    rest = np.array([K_m * DEPTH / K, 0.0])
    exact = np.array([(expm(A * t) @ (np.array([DEPTH, 0.0]) - rest) + rest)[0] for t in record["t"]])
    return Response(M_e, period, record["t"], record["phi"], exact)


def start(name: str, choice: str) -> MeasuredStart:
    """Start of a shipped scenario, its first second. choice: `controller.on_change`."""
    scenario = edited(edited(shipped()[name], "controller.on_change", choice), "simulation.duration", 1.0)
    loop, metrics = simulate(scenario)
    record = loop.recording.signals(("s_norm", "s_band"))
    reached = np.nan if metrics.band_time is None else metrics.band_time
    largest = float(np.nanmax(record["s_norm"] / record["s_band"]))
    return MeasuredStart(name, choice, float(record["s_norm"][0]), largest, reached)


def free(omega: float, zeta: float, scale: float) -> MeasuredOscillation:
    """Free oscillation of (26): the error of a UR5 with links 15 % heavier than believed, whose reference starts at
    full speed."""
    scenario = changed(
        shipped()["ur5-motion"],
        target_model=_oscillator(omega, zeta),
        controller=_fine(scale),
        motion={"kind": "circle", "radius": 0.05, "period": 4.0, "ramp": 0.0, "axes": [0, 1]},
        simulation={"duration": _span(omega, zeta)},
    )
    record = simulate(scenario)[0].recording.signals(("t", "e_r", "e_r_dot"))
    along = int(np.argmax(np.abs(record["e_r_dot"][0])))
    return MeasuredOscillation("free, (26)", scale, omega, zeta, record["t"], record["e_r"][:, along])


def pressing(K_e: float, zeta: float, scale: float) -> MeasuredOscillation:
    """Oscillation of (35) with K_m1 = 0 and K_e known: a tool that starts too deep in an elastic surface, on the arm of
    `free`."""
    base = shipped()["ur5-hybrid"]
    height = ClosedLoop.from_scenario(base).view().tool[2].item() + 2.0 * DEPTH
    omega = float(np.sqrt(K_e / INERTIA))
    model = _oscillator(omega, zeta)
    scenario = changed(
        base,
        target_model={"M_m": model["M_m"], "B_m": [model["B_m"][0]] + [400.0] * 5, "K_m": [0.0] + [4000.0] * 5},
        surface={"kind": "plane", "origin": [0.0, 0.0, height]},
        contact={"K_e": K_e, "unilateral": False},
        controller=_fine(scale) | {"K_e_hat": K_e},
        motion={"kind": "hold"},
        simulation={"duration": _span(omega, zeta)},
    )
    record = simulate(scenario)[0].recording.signals(("t", "e_r"))
    return MeasuredOscillation("pressing, (35)", scale, omega, zeta, record["t"], record["e_r"][:, 0])


def _fine(scale: float) -> dict[str, float]:
    return {"period": scale * ControllerSection().period, "layer": scale * ControllerSection().layer}


def _oscillator(omega: float, zeta: float) -> dict[str, list[float]]:
    return {
        "M_m": [INERTIA] * 6,
        "B_m": [2.0 * zeta * omega * INERTIA] * 6,
        "K_m": [omega**2 * INERTIA] * 6,
    }


def _span(omega: float, zeta: float) -> float:
    """Duration of an oscillation until little is left of it, s."""
    return min(5.0 / (zeta * omega), 4.0)


def recovered(t: np.ndarray, error: np.ndarray) -> tuple[float, float]:
    """Omega (rad/s) and zeta < 1 of a free oscillation. error: (N,). t: (N,) s, in equal steps.

    Prony's method on the whole response, x_(k+2) = a x_(k+1) + b x_k, gives the start of a fit by least squares.
    """
    few = max(len(t) // 60, 1)
    x, step = error[::few], float(t[few] - t[0])
    a, b = np.linalg.lstsq(np.stack([x[1:-1], x[:-2]], axis=1), x[2:], rcond=None)[0]
    pole = complex(np.log(np.roots([1.0, -a, -b]).astype(complex)[0]) / step)

    def response(t: np.ndarray, sigma: float, omega_d: float, c: float, s: float) -> np.ndarray:
        return np.exp(-sigma * t) * (c * np.cos(omega_d * t) + s * np.sin(omega_d * t))

    size = float(np.abs(error).max())
    guess = (-pole.real, abs(pole.imag), error[0] / size, 0.5)
    (sigma, omega_d, *_), _ = curve_fit(response, t, error / size, guess)
    omega = float(np.hypot(sigma, omega_d))
    return omega, float(sigma / omega)


def force_loop(factor: float) -> MeasuredForceLoop:
    """Force loop of a known UR5 that holds still on a rigid surface. factor: of the loop through the multiplier, which
    sets M_m1."""
    base = certain(shipped()["ur5-constrained"])
    system = assemble(base)
    estimate, task = system.observe(system.q_0, np.zeros(6), 0.0)
    H_inv = np.linalg.inv(task.J_q_inv.T @ estimate.M_hat @ task.J_q_inv)
    M_m1 = float(1.0 / H_inv[0, 0] / (1.0 - factor))  # factor = 1 - h / M_m1 with the effective mass h
    scenario = changed(
        base,
        motion={"kind": "hold"},
        contact={"unilateral": False},
        target_model={"M_m": [M_m1] + [10.0] * 5, "B_m": [100.0] + [400.0] * 5},
        controller={"K_s": 1.0, "epsilon": 0.01, "layer": 1.0},  # the robust term has nothing to do where s = 0
        force={"kind": "step", "start": 10.0, "value": 20.0, "time": 0.0002, "rise": 0.0005},  # within a period
        simulation={"duration": 0.02},
    )
    record = simulate(scenario)[0].recording.signals(("multiplier", "F_cd"))
    return MeasuredForceLoop(M_m1, factor, (record["multiplier"] - record["F_cd"][:, 0])[1:])


def multiplier(period: float, reading: Reading) -> Multiplier:
    """Errors of the multiplier of a UR5 that slides on a rigid surface while lambda_d varies, with links 15 % heavier
    than believed. period: of the control, s."""
    scenario = changed(
        shipped()["ur5-constrained"],
        force={"kind": "sinusoid", "value": 20.0, "amplitude": 5.0, "frequency": 1.0},
        sensor={"ideal": reading == "solved"},
        controller={"period": period},
        simulation={"duration": 1.0},
    )
    record = simulate(scenario)[0].recording.signals(("multiplier", "F_cd", "phi"), t_from=0.5)
    error = np.abs(record["multiplier"] - record["F_cd"][:, 0]).max()
    return Multiplier(reading, period, float(error), float(np.abs(record["phi"]).max()))
