"""What is too stiff for the plant's step is refused, with a remedy that works; what sampling spoils is foretold."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm

from app.scenario.data import edited, shipped, with_values
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.changes import in_mode, on_robot
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.period_map import PeriodMap, Posture
from app.simulation.sampled_force_loop import force_factor
from app.simulation.sampled_stability import sampled_loop
from app.simulation.system import System
from controllers.premises import Premise
from environments.contact import Contact
from environments.contact_kinds import CONTACTS
from environments.integrators import Integrator
from environments.plant import Plant
from environments.step_resolution import (
    STEPS,
    Mobility,
    Oscillator,
    oscillators,
    resolved,
    spectral_radius,
    substeps_needed,
)
from tests.support.arms import arm
from tests.support.surfaces import plane, to_third

pytestmark = pytest.mark.slow  # long or many simulations

H = 1e-3  # s


def radius(system: System) -> float:
    """Growth of a deviation per control period, on the surface if there is one."""
    return sampled_loop(system, system.q_0, 0.0).premises[Premise.SAMPLED_LOOP]


INTEGRATORS: tuple[Integrator, ...] = tuple(STEPS)


def edge(integrator: Integrator, damping_ratio: float) -> float:
    """The largest h omega at which the oscillator still settles, by bisection."""
    low, high = 1e-3, 10.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        settles = resolved(integrator, Oscillator("", 0.0, "", middle**2, 2 * damping_ratio * middle), 1.0)
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
def test_substeps_needed_are_the_fewest(integrator: Integrator, stiffness: float, damping: float) -> None:
    stiff = Oscillator("", 0.0, "", stiffness, damping)
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
    return Mobility.largest(M[None], tool.J_v[None], plant.surface.chart(tool.p, 0.0).G[:1])


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("cause", CAUSES)
@pytest.mark.parametrize("robot", ["ur5", "planar2r"])
def test_plant_explodes_where_its_step_is_said_to(robot: str, cause: str, integrator: Integrator) -> None:
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
        rows = oscillators(CONTACTS[kind], *parts, mobility(system, plant))
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


def changed(scenario: Scenario, **fields: Any) -> Scenario:
    """Fields by their dotted paths, with "__" for the dot."""
    for path, value in fields.items():
        scenario = edited(scenario, path.replace("__", "."), value)
    return scenario


def pressing(robot: str, K_e: float, period: float, **fields: Any) -> Scenario:
    """A known arm at rest on a plane that its tool just touches, pressing with 20 N."""
    height = float(arm(robot).nominal.evaluate(arm(robot).q_0, np.zeros(arm(robot).robot.n)).p[2])
    scenario = changed(
        shipped()[f"{robot}-hybrid"], truth__link_scaling=1.0, declared__link_scaling=0.0, motion="hold",
        contact__K_e=K_e, controller__period=period, surface__origin=[0.0, 0.0, height], simulation__duration=1.0,
    )  # fmt: skip
    return changed(scenario, **fields)


def run(scenario: Scenario, duration: float) -> ClosedLoop:
    loop = ClosedLoop.from_scenario(scenario)
    for _ in range(round(duration / scenario.controller.period)):
        loop.step()
        assert loop.stopped is None
    return loop


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize(("robot", "K_e", "period"), [("planar3r", 1e6, 0.005), ("ur5", 1e6, 0.01)])
def test_stiff_contact_is_refused_with_a_remedy(robot: str, K_e: float, period: float, integrator: str) -> None:
    """The sentence names the field, its value and the substeps; half of them are refused too, and with them the force
    settles to f_nd (36), whatever the estimate of the stiffness."""
    scenario = pressing(robot, K_e, period, simulation__integrator=integrator, controller__layer=0.2)
    with pytest.raises(ScenarioError) as refusal:
        ClosedLoop.from_scenario(scenario)
    said = str(refusal.value)
    assert said.startswith(f"contact.K_e: 1e+06 N/m is too stiff for 1 step(s) of {integrator}")
    enough = int(said.split("simulation.substeps >= ")[1].split(",")[0])
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
    ("field", "value", "said"),
    [
        ("contact__B_e", 1e4, "contact.B_e: 10000 N·s/m is too stiff"),
        ("contact__friction_viscous", 1e4, "contact.friction_viscous: 10000 N·s/m is too stiff"),
        ("truth__viscous", 100.0, "truth.viscous: 100 N·m·s/rad is too stiff"),
    ],
)
def test_everything_stiff_is_refused_by_its_own_name(field: str, value: float, said: str) -> None:
    with pytest.raises(ScenarioError) as refusal:
        assemble(pressing("planar3r", 1e4, H, **{field: value}))
    assert str(refusal.value).startswith(said)


def test_a_third_surface_beside_the_first_is_refused_by_its_own_name() -> None:
    slow = edited(shipped()["ur5-corner"], "controller.period", 0.002)
    corner = to_third(edited(slow, "second.contact.K_e", 1e7))
    with pytest.raises(ScenarioError, match=r"^third\.contact\.K_e: 1e\+07 N/m is too stiff"):
        assemble(corner)


def test_what_is_too_stiff_does_not_depend_on_what_was_before() -> None:
    light = edited(edited(shipped()["ur5-hybrid"], "controller.period", 0.002), "truth.link_scaling", [0.5] + [1.0] * 5)

    def outcome(K_e: float, previous: System | None = None) -> tuple[str, System | None]:
        try:
            return "accepted", assemble(edited(light, "contact.K_e", K_e), previous)
        except ScenarioError as error:
            return str(error), previous

    values = np.geomspace(1e6, 1e7, 12).tolist()
    afresh = [outcome(K_e)[0] for K_e in values]
    assert "accepted" in afresh[3:]  # where the estimate from the believed arm alone would refuse
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


@pytest.mark.parametrize(
    ("robot", "fields"),
    [
        ("planar3r", {"contact__K_e": 1.6e6, "sensor__delay": 0.003}),
        ("planar3r", {"contact__K_e": 2e6, "sensor__delay": 0.003, "simulation__integrator": "rk4"}),
        ("planar3r", {"contact__K_e": 1.4e6, "sensor__delay": 0.003, "controller__law": "computed-torque"}),
        ("planar3r", {"contact__K_e": 1e5, "controller__law": "pd-gravity", "simulation__substeps": 1}),
        ("planar3r", {"contact__K_e": 1e6, "contact__B_e": 200.0, "sensor__delay": 0.006}),
        ("planar3r", {"contact__K_e": 6e6, "sensor__cutoff": 30.0, "simulation__substeps": 4}),
        ("ur5", {"contact__K_e": 1e5, "sensor__delay": 0.005}),
        ("ur5", {"contact__K_e": 1e4, "controller__K_e_hat": 1e6}),
    ],
)
def test_growth_on_the_surface_is_what_the_loop_does(robot: str, fields: dict[str, Any]) -> None:
    """A deviation too small for anything but the linear, of the running loop: period for period as the radius says."""
    # with the torque held exactly: so is it, nearly, in plant steps much shorter than the control period
    fine = {"simulation__substeps": 8, "contact__unilateral": False}
    scenario = pressing(robot, 1e4, H, **fine | fields)
    system = assemble(scenario)
    growth = radius(system)
    f_nd = 1e-5 if growth > 1.0 else 10.0
    loop = ClosedLoop.from_scenario(edited(scenario, "force.value", f_nd))
    for _ in range(round(math.log(1e5) / abs(math.log(growth)))):
        loop.step()
    error = np.abs(loop.recording.signals(("multiplier",))["multiplier"] - f_nd)
    fifth = len(error) // 5
    early, late = error[2 * fifth : 3 * fifth].max(), error[4 * fifth :].max()
    assert math.log(late / early) / (2 * fifth) == pytest.approx(math.log(growth), rel=0.1)
    assert (loop.warning is not None) == (growth > 1.0)
    if growth > 1.0:
        assert "the sampled loop swings up" in (loop.warning or "")
        assert loop.standing.now.verdict == "nothing promised"


LIMITS: dict[str, tuple[str, str, tuple[float, float], dict[str, Any]]] = {
    "leapfrog": ("planar3r", "contact__K_e", (1e5, 2e6), {"sensor__delay": 0.004}),
    "semi-implicit Euler": (
        "planar3r", "contact__K_e", (1e5, 2e6),
        {"sensor__delay": 0.004, "simulation__integrator": "semi-implicit-euler"},
    ),
    "RK4": ("planar3r", "contact__K_e", (1e5, 2e6), {"sensor__delay": 0.004, "simulation__integrator": "rk4"}),
    "low-pass": ("planar3r", "contact__K_e", (1e5, 2e6), {"sensor__delay": 0.003, "sensor__cutoff": 200.0}),
    "computed torque": (
        "planar3r", "contact__K_e", (1e5, 2e6), {"sensor__delay": 0.004, "controller__law": "computed-torque"}
    ),
    "PD with gravity": ("planar3r", "target_model__B_m", (500.0, 20000.0), {"controller__law": "pd-gravity"}),
    "surface with a mass": (
        "planar3r", "contact__K_e", (1e5, 4e6),
        {"contact__kind": "mass-damper-spring", "contact__M_e": 2.0, "sensor__delay": 0.006},
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", LIMITS)
def test_runs_on_either_side_of_the_limit_diverge_and_do_not(case: str) -> None:
    """The limit as the period's own Jacobian has it, found by bisection, for every law, sensor and integrator."""
    robot, field, (low, high), fields = LIMITS[case]
    n = arm(robot).robot.n

    def at(value: float) -> Scenario:
        given = [value] * n if field == "target_model__B_m" else value
        return pressing(robot, 1e4, H, **{"contact__unilateral": False} | fields | {field: given})

    assert radius(assemble(at(low))) < 1.0 < radius(assemble(at(high)))
    for _ in range(8):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if radius(assemble(at(middle))) > 1.0 else (middle, high)

    def swing(value: float) -> float:
        """Of the force around 1e-5 N, late over early: of a deviation too small for anything but the linear."""
        loop = ClosedLoop.from_scenario(edited(at(value), "force.value", 1e-5))
        rate = abs(math.log(radius(loop.system)))
        for _ in range(round(math.log(1e4) / rate)):
            loop.step()
        q_dot = loop.recording.signals(("q_dot",))["q_dot"]
        fifth = len(q_dot) // 5
        return float(np.abs(q_dot[4 * fifth :]).max() / np.abs(q_dot[fifth : 2 * fifth]).max())

    assert swing(0.8 * low) < 0.5
    assert swing(1.25 * high) > 2.0


@pytest.mark.parametrize("kind", ["elastic", "mass-damper-spring"])
@pytest.mark.parametrize("ideal", [False, True])
def test_every_sensor_is_judged(kind: str, ideal: bool) -> None:
    """An ideal sensor shows the force of now only where that depends on the torque: elsewhere it is as late as any."""
    fields = {"sensor__delay": 0.004, "sensor__cutoff": 100.0, "sensor__ideal": ideal, "contact__kind": kind}
    quick, late = (
        assemble(pressing("planar3r", 1e5, H, **fields | {"contact__M_e": 2.0} | given))
        for given in ({"sensor__delay": 0.0, "sensor__cutoff": 0.0}, {})
    )
    sees_delay = not (ideal and kind == "mass-damper-spring")
    assert (abs(radius(late) - radius(quick)) > 1e-6) == sees_delay
    size = len(PeriodMap(late, Posture.of(late, late.q_0, 0.0)).jacobian())
    assert size == 3 * 3 + 3 * (1 + 4) + 3 * (kind == "mass-damper-spring" and not ideal)


@pytest.mark.parametrize("M_m1", [5.0, 10.0, 30.0])
def test_the_closed_form_of_the_force_loop_is_an_eigenvalue_of_the_period(M_m1: float) -> None:
    scenario = changed(
        shipped()["ur5-constrained"], controller__law="computed-torque", target_model={"M_m": [M_m1] + [12.0] * 5},
        truth__link_scaling=1.0,
    )  # fmt: skip
    system = assemble(scenario)
    at = Posture.of(system, system.q_0, 0.0)
    values, factor = np.linalg.eigvals(PeriodMap(system, at).jacobian()), force_factor(system, at)
    assert np.abs(values - factor).min() < 1e-4 * abs(factor)


@pytest.mark.parametrize("M_m1", [2.5, 10.0])
@pytest.mark.parametrize(("cutoff", "delay"), [(20.0, 0.0), (50.0, 0.003), (0.0, 0.003)])
def test_a_low_pass_changes_the_factor_of_the_force_loop_and_a_delay_alone_does_not(
    M_m1: float, cutoff: float, delay: float
) -> None:
    """A low-pass of gain g makes 1 - g (1 - f) of the factor f; behind a delay, too, it is the fastest of several
    eigenvalues that belong to the force loop."""
    without = changed(
        shipped()["ur5-constrained"], controller__law="computed-torque", target_model={"M_m": [M_m1] + [12.0] * 5},
        truth__link_scaling=1.0,
    )  # fmt: skip
    plain, system = assemble(without), assemble(changed(without, sensor={"cutoff": cutoff, "delay": delay}))
    at = Posture.of(system, system.q_0, 0.0)
    f, factor = force_factor(plain, at), force_factor(system, at)
    if cutoff == 0.0:
        assert factor == pytest.approx(f, rel=1e-12)
        return
    gain = 1.0 - math.exp(-2 * math.pi * cutoff * 0.001)
    values = np.linalg.eigvals(PeriodMap(system, at).jacobian())
    if delay == 0.0:
        assert factor == pytest.approx(1.0 - gain * (1.0 - f), rel=1e-12)
        assert np.abs(values - factor).min() < 1e-4 * abs(factor)
    else:
        z = values[np.abs(np.abs(values) - factor).argmin()]
        assert z**3 * (z - 1.0 + gain) == pytest.approx(gain * f, rel=1e-2)


def test_a_force_loop_that_a_low_pass_calms_is_not_said_to_diverge() -> None:
    fields = {"controller__gain": "constant", "controller__d": 60.0, "truth__link_scaling": 1.0}
    scenario = changed(shipped()["ur5-constrained"], target_model={"M_m": [2.5] + [10.0] * 5}, **fields)
    factors = []
    for cutoff in (0.0, 20.0):
        loop = ClosedLoop.from_scenario(changed(scenario, sensor={"cutoff": cutoff}))
        for _ in range(400):
            loop.advance()
        last = loop.recording.at(loop.t)
        settles = loop.stopped is None and abs(last["multiplier"][0] - last["F_cd"][0]) < 0.1
        factors.append((loop.sampled.force_factor, settles, "force loop diverges" in (loop.warning or "")))
    assert [(abs(factor) < 1.0, settles, said) for factor, settles, said in factors] == [
        (False, False, True),
        (True, True, False),
    ]


@pytest.mark.parametrize("law", ["pd-gravity", "computed-torque"])
def test_estimates_along_the_reference_do_not_move_with_the_arm(law: str) -> None:
    """G_hat(q_d) of Remark 3 does not follow q: with little stiffness gravity makes a deviation grow, as fast as the
    period's map says."""
    growth = {}
    for estimates in ("online", "along-reference"):
        scenario = with_values(
            shipped()["ur5-joint"],
            {
                "controller.law": law, "controller.estimates": estimates, "motion": {"kind": "hold"}, "declared": {},
                "truth": {},
                "target_model.M_m": (1.0,) * 6, "target_model.B_m": (12.0,) * 6, "target_model.K_m": (2.0,) * 6,
                "simulation.domain_radius": 0.6,
            },
        )  # fmt: skip
        loop = ClosedLoop.from_scenario(scenario)
        loop.state.arm.views.q[1:3] += 1e-4
        CompiledRun(loop).advance(3000)
        away = np.linalg.norm(loop.recording.signals(("e_r",))["e_r"], axis=1)
        growth[estimates] = radius(loop.system), math.log(away[2999] / away[2499]) / 500
    assert growth["online"][0] < 1.0 < growth["along-reference"][0]
    assert growth["online"][1] < 0.0
    assert growth["along-reference"][1] == pytest.approx(math.log(growth["along-reference"][0]), rel=0.06)


def test_growth_is_foretold_where_the_normal_is_oblique_to_every_coordinate() -> None:
    """Impedance in Cartesian coordinates on an inclined plane: the multiplier acts on all of r."""
    system, normal = arm("planar3r"), np.array([0.3, 0.0, -0.95])
    normal /= np.linalg.norm(normal)
    touched = system.nominal.evaluate(system.q_0, np.zeros(3)).p - 1e-12 * normal
    loop = ClosedLoop.from_scenario(
        changed(
            in_mode(pressing("planar3r", 1e4, H), "impedance"), contact__K_e=2e6, contact__unilateral=False,
            sensor__delay=0.003, surface__origin=touched.tolist(), surface__normal=normal.tolist(),
            simulation__substeps=8,
        )
    )  # fmt: skip
    growth = radius(loop.system)
    assert 1.05 < growth < 1.2
    for _ in range(100):
        loop.step()
    change = np.abs(np.diff(loop.recording.signals(("multiplier",))["multiplier"]))
    assert math.log(change[80:].max() / change[40:60].max()) / 40 == pytest.approx(math.log(growth), rel=0.1)
    assert "the sampled loop swings up" in (loop.warning or "")


@pytest.mark.parametrize("name", ["ur5-motion", "ur5-constrained", "ur5-hybrid", "ur5-impedance"])
def test_shipped_loops_contract_in_free_motion_as_in_contact(name: str) -> None:
    assert radius(assemble(shipped()[name])) < 1.0


@pytest.mark.parametrize("switching", ["discontinuous", "saturation"])
def test_the_motion_on_the_sliding_surface_is_judged_where_it_reads_a_contact(switching: str) -> None:
    """With 0.1 s of delay the force swings between 0 and 46 N, under a law that chatters, too; of a delay that is too
    long to be judged nothing is promised."""
    base = edited(shipped()["ur5-hybrid"], "controller.switching", switching)
    late = {delay: edited(base, "sensor.delay", delay) for delay in (0.02, 0.1, 0.101)}
    assert radius(assemble(late[0.02])) < 1.0 < radius(assemble(late[0.1])) < 1.01
    for delay in (0.1, 0.101):
        loop = run(edited(late[delay], "declared.force_error", 60.0), 3.0)
        force = loop.recording.signals(("multiplier",), t_from=2.0)["multiplier"]
        assert force.min() == 0.0
        assert force.max() > 40.0
        assert loop.standing.run.verdict == "nothing promised"
    assert radius(assemble(late[0.101])) == math.inf
    assert "is not known: the force sensor is late" in loop.warning
    assert math.isnan(radius(assemble(shipped()["ur5-motion-discontinuous"])))


@pytest.mark.parametrize(("name", "arms"), [("ur5-motion", "ur10"), ("ur5-motion", "ur5")])
def test_a_layer_too_thin_swings_up_in_free_motion_too(name: str, arms: str) -> None:
    """Layer factors of 11 and 3.3 gave no warning where nothing was touched."""
    scenario = edited(edited(on_robot(shipped()[name], arms), "controller.layer", 0.001), "truth.link_scaling", 1.1)
    loop = run(scenario, 0.3)
    findings = {finding.premise: finding for finding in loop.standing.findings}
    assert not findings["layer"].holds
    assert not findings["sampled_loop"].holds
    assert findings["layer"].failed == 0.0
    assert loop.standing.run.verdict == "nothing promised"
    calm = run(shipped()[name], 0.3)
    assert calm.standing.run.verdict == "holds"


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

    found = {name: damping(np.array(step(acceleration, x, v, T))) for name, step in STEPS.items()}
    assert exact == pytest.approx(0.098, abs=0.003)
    assert found["leapfrog"] == pytest.approx(exact, abs=1e-4)
    assert found["rk4"] == pytest.approx(exact, abs=1e-4)
    assert found["semi-implicit-euler"] > 0.118  # its own error cancels what sampling does
