"""What is too stiff for the plant's step is refused, with a remedy that works."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm

from app.scenario.data import edited, shipped
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.system import System
from environments.contact import Contact
from environments.contact_kinds import CONTACTS
from environments.integrators import INTEGRATORS, IntegratorName
from environments.plant import Plant
from environments.step_resolution import (
    Mobility,
    StiffElement,
    mobilities,
    resolved,
    spectral_radius,
    stiff_elements,
    substeps_needed,
)
from tests.support.arms import arm
from tests.support.pressing import H, changed, pressing, run
from tests.support.surfaces import plane, to_third

pytestmark = pytest.mark.slow  # long or many simulations


def edge(integrator: IntegratorName, damping_ratio: float) -> float:
    """The largest h omega at which the oscillator still settles, by bisection."""
    low, high = 1e-3, 10.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        settles = resolved(integrator, StiffElement("", 0.0, "", middle**2, 2 * damping_ratio * middle), 1.0)
        low, high = (middle, high) if settles else (low, middle)
    return low


@pytest.mark.parametrize("damping_ratio", [0.0, 0.1, 0.5, 1.0, 3.0])
def test_edges_of_the_integrators_are_the_known_ones(damping_ratio: float) -> None:
    """Semi-implicit Euler: (h omega)^2 + 4 zeta h omega = 4, both conditions of Jury for its matrix. RK4: where
    |1 + y + y^2/2 + y^3/6 + y^4/24| = 1 for y = h lambda of the slower settling pole."""
    euler = 2 * math.sqrt(damping_ratio**2 + 1) - 2 * damping_ratio
    assert edge("semi-implicit-euler", damping_ratio) == pytest.approx(euler, rel=1e-6)
    y = edge("rk4", damping_ratio) * np.roots([1.0, 2 * damping_ratio, 1.0])
    growth = np.abs(1 + y + y**2 / 2 + y**3 / 6 + y**4 / 24)
    assert growth.max() == pytest.approx(1.0, abs=2e-7)
    if damping_ratio == 0.0:
        assert edge("rk4", 0.0) == pytest.approx(math.sqrt(8.0), rel=1e-6)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("stiffness", [0.0, 1.0, 1e4, 1e6, 1e9])
@pytest.mark.parametrize("damping", [0.0, 10.0, 1e5])
def test_substeps_needed_are_the_fewest(integrator: IntegratorName, stiffness: float, damping: float) -> None:
    stiff = StiffElement("", 0.0, "", stiffness, damping)
    enough = substeps_needed(integrator, stiff, 0.005, most=1000)
    assert enough is not None
    assert spectral_radius(integrator, stiffness, damping, 0.005 / enough) <= 1.0 + 1e-6
    if enough > 1:
        assert not resolved(integrator, stiff, 0.005 / (enough - 1))
        assert substeps_needed(integrator, stiff, 0.005, most=enough - 1) is None


CAUSES: dict[str, tuple[str, dict[str, float]]] = {
    "contact.K_e": ("elastic", {}),
    "contact.K_e, damped": ("elastic", {"B_e": 300.0}),
    "contact.K_e, with a mass": ("mass-damper-spring", {"M_e": 4.0, "B_e": 100.0}),
    "contact.B_e": ("elastic", {"K_e": 100.0}),
    "contact.friction_viscous": ("elastic", {"K_e": 1000.0}),
    "truth.viscous": ("free", {}),
}


def mobility(system: System, plant: Plant) -> Mobility:
    tool = system.nominal.evaluate(system.q_0, np.zeros(system.robot.n))
    M = pin.crba(plant.model, plant.model.createData(), system.q_0)
    return Mobility(*mobilities(M[None], tool.J_v[None], plant.surface.chart(tool.p, 0.0).G[None, :1])[0])


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("cause", CAUSES)
@pytest.mark.parametrize("robot", ["ur5", "planar2r"])
def test_plant_explodes_where_its_step_is_said_to(robot: str, cause: str, integrator: IntegratorName) -> None:
    """A nudged arm on a bilateral surface, gravity and contact balanced: quiet 3 % below the edge, wild 3 % above."""
    system, (kind, given), field = arm(robot), CAUSES[cause], cause.split(",")[0]
    still = np.zeros(system.robot.n)
    surface = plane(system.nominal.evaluate(system.q_0, still).p, np.array([0.28, 0.0, -0.96]))
    name = field.split(".")[1]

    def plant_with(value: float) -> Plant:
        law = Contact(0.0, 0.0, 0.0, False, 0.0, 0.0)._replace(**given)
        truth = replace(system.plant.truth, link_scaling=np.full(system.robot.n, 1.1))
        if name == "viscous":
            truth = replace(truth, viscous=value)
        else:
            law = law._replace(**{name: value})
        return Plant(system.robot, truth, (surface,), CONTACTS[kind], (law,), integrator)

    def settles(value: float) -> bool:
        plant = plant_with(value)
        parts = (plant.contacts, plant.environment, plant.truth)
        rows = stiff_elements(CONTACTS[kind], *parts, mobility(system, plant))
        return resolved(integrator, next(o for o in rows if o.field == field), H)

    low, high = 0.0, 1e9
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if settles(middle) else (low, middle)

    def swing(value: float) -> float:
        plant = plant_with(value)
        state = plant.start(system.q_0, 1e-6 * np.random.default_rng(0).standard_normal(system.robot.n), 0.0)
        weight = pin.computeGeneralizedGravity(plant.model, plant.model.createData(), system.q_0)
        for k in range(400):
            plant.advance(state, weight, k * H, H)
            if not np.abs(state.views.q_dot).max() < 1.0:
                return np.inf
        return float(np.abs(state.views.q_dot).max())

    assert swing(0.97 * low) < 1e-4
    assert swing(1.03 * low) > 1e-2


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize(("robot", "K_e", "period"), [("planar3r", 1e6, 0.005), ("ur5", 1e6, 0.01)])
def test_stiff_contact_is_refused_with_a_remedy(robot: str, K_e: float, period: float, integrator: str) -> None:
    """The sentence names the field, its value and the substeps; half of them are refused too, and with them the force
    settles to f_nd (36), whatever the estimate of the stiffness."""
    scenario = pressing(robot, K_e, period, simulation__integrator=integrator, controller__layer=0.2)
    with pytest.raises(ScenarioError) as refusal:
        ClosedLoop.from_scenario(scenario)
    message = str(refusal.value)
    assert message.startswith(f"contact.K_e: 1e+06 N/m is too stiff for 1 step(s) of {integrator}")
    enough = int(message.split("simulation.substeps >= ")[1].split(",")[0])
    assert enough > 1
    if enough > 3:
        with pytest.raises(ScenarioError, match=r"contact\.K_e"):
            ClosedLoop.from_scenario(edited(scenario, "simulation.substeps", enough // 2))
    remedied = changed(
        scenario, simulation__substeps=enough, target_model={"B_m": [2000.0] + [400.0] * (2 if robot != "ur5" else 5)}
    )
    loop = run(remedied, 2.0)
    assert loop.recording.at(loop.t)["multiplier"][0] == pytest.approx(20.0, abs=1e-3)


@pytest.mark.parametrize("robot", ["ur5", "planar3r"])
@pytest.mark.parametrize("K_e", [1e5, 1e6])
def test_stiff_contact_at_1_kHz_settles_to_the_closed_form(robot: str, K_e: float) -> None:
    """(37) with K_m1 > 0 and an estimate ten times too soft."""
    K_m1, K_e_hat, f_nd, n = 5e4, K_e / 10.0, 20.0, arm(robot).robot.n
    model = {"K_m": [K_m1] + [4000.0] * (n - 1), "B_m": [2000.0] + [400.0] * (n - 1)}
    loop = run(pressing(robot, K_e, H, controller__K_e_hat=K_e_hat, target_model=model), 1.0)
    e_fn = (1 - K_e / (K_m1 + K_e)) * (K_e - K_e_hat) / K_e_hat * f_nd
    assert loop.warning is None
    assert loop.recording.at(loop.t)["multiplier"][0] - f_nd == pytest.approx(e_fn, rel=1e-3)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("contact__B_e", 1e4, "contact.B_e: 10000 N·s/m is too stiff"),
        ("contact__friction_viscous", 1e4, "contact.friction_viscous: 10000 N·s/m is too stiff"),
        ("truth__viscous", 100.0, "truth.viscous: 100 N·m·s/rad is too stiff"),
    ],
)
def test_everything_stiff_is_refused_by_its_own_name(field: str, value: float, message: str) -> None:
    with pytest.raises(ScenarioError) as refusal:
        assemble(pressing("planar3r", 1e4, H, **{field: value}))
    assert str(refusal.value).startswith(message)


def test_a_third_surface_beside_the_first_is_refused_by_its_own_name() -> None:
    slow = edited(shipped()["ur5-corner"], "controller.period", 0.002)
    corner = to_third(edited(slow, "second.contact.K_e", 1e7))
    with pytest.raises(ScenarioError, match=r"^third\.contact\.K_e: 1e\+07 N/m is too stiff"):
        assemble(corner)


def test_stiffness_check_is_independent_of_the_previous_system() -> None:
    believed = edited(edited(shipped()["ur5-hybrid"], "controller.period", 0.002), "truth.link_scaling", 1.0)
    light = edited(believed, "truth.link_scaling", [0.5] + [1.0] * 5)

    def outcome(K_e: float, previous: System | None = None, arm: Scenario = light) -> tuple[str, System | None]:
        try:
            return "accepted", assemble(edited(arm, "contact.K_e", K_e), previous)
        except ScenarioError as error:
            return str(error), previous

    values = np.geomspace(1e6, 1e7, 12).tolist()
    afresh = [outcome(K_e)[0] for K_e in values]
    # half of the first link changes the mobility by a hundred-thousandth; the estimate from the believed arm doubles it
    assert afresh == [outcome(K_e, arm=believed)[0] for K_e in values]
    assert afresh[0] == "accepted"
    assert afresh[-1].startswith("contact.K_e")
    for order in (values, values[::-1]):
        system, found = assemble(light), dict[float, str]()
        for K_e in order:
            found[K_e], system = outcome(K_e, system)
        assert [found[K_e] for K_e in values] == afresh


def test_a_loop_that_runs_goes_on_when_a_stiffness_is_refused() -> None:
    loop = run(pressing("planar3r", 1e4, H), 0.01)
    gentle = loop.system.scenario
    with pytest.raises(ScenarioError, match=r"contact\.K_e: 1e\+07 N/m .* simulation\.substeps >= 3"):
        loop.edit(edited(gentle, "contact.K_e", 1e7))
    assert loop.system.scenario == gentle
    loop.step()
    assert loop.stopped is None


@pytest.mark.parametrize("mass", [4.0, 10.0, 20.0])
def test_the_leapfrog_shows_what_a_held_torque_costs_of_damping(mass: float) -> None:
    """A wall, M_m 2.7, B_m 61, K_m 380, K_f 3.3, K_e 7300: zeta 0.1187 in continuous time. One axis under the ideal
    law, torque held for 1 ms: exactly, by the matrix exponential, against one step of each integrator."""
    M_m, B_m, K_m, K_f, K_e, T = 2.7, 61.0, 380.0, 3.3, 7300.0, 1e-3

    def damping(step: np.ndarray) -> float:
        poles = np.log(np.linalg.eigvals(step).astype(complex)) / T
        return float((-poles.real / np.abs(poles)).min())

    x, v = np.eye(2)
    torque = mass * -(B_m * v + K_m * x + K_f * K_e * x) / M_m + K_e * x  # and what the arm feels is given back
    rates = np.array([[0.0, 1.0, 0.0], [-K_e / mass, 0.0, 1.0 / mass], [0.0, 0.0, 0.0]])
    exact = damping((expm(rates * T) @ np.vstack([x, v, torque]))[:2])

    def acceleration(x: np.ndarray, _: np.ndarray) -> np.ndarray:
        return (torque - K_e * x) / mass

    found = {name: damping(np.array(each.step(acceleration, x, v, T))) for name, each in INTEGRATORS.items()}
    assert exact == pytest.approx(0.098, abs=0.003)
    assert found["leapfrog"] == pytest.approx(exact, abs=1e-4)
    assert found["rk4"] == pytest.approx(exact, abs=1e-4)
    assert found["semi-implicit-euler"] > 0.118  # its own error cancels what sampling does
