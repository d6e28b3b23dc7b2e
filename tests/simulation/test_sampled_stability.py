"""The closed loop as a map from one control period to the next: what sampling spoils is foretold."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.scenario import own_code
from app.scenario.data import edited, load, shipped, with_values
from app.scenario.schema import Scenario
from app.session.changes import in_mode, on_robot
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.sampled_loop.period_map import PeriodMap, Posture
from app.simulation.sampled_loop.sampled_stability import sampled_loop, touched_at_once
from controllers.premises import Premise
from tests.support import law_of_s
from tests.support.arms import arm
from tests.support.pressing import H, changed, growth_per_period, pressing, run

pytestmark = pytest.mark.slow  # long or many simulations


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
    growth = growth_per_period(system)
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
        assert "the sampled loop is unstable" in (loop.warning or "")
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

    assert growth_per_period(assemble(at(low))) < 1.0 < growth_per_period(assemble(at(high)))
    for _ in range(8):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if growth_per_period(assemble(at(middle))) > 1.0 else (middle, high)

    def swing(value: float) -> float:
        """Of the force around 1e-5 N, late over early: of a deviation too small for anything but the linear."""
        loop = ClosedLoop.from_scenario(edited(at(value), "force.value", 1e-5))
        rate = abs(math.log(growth_per_period(loop.system)))
        for _ in range(round(math.log(1e4) / rate)):
            loop.step()
        q_dot = loop.recording.signals(("q_dot",))["q_dot"]
        fifth = len(q_dot) // 5
        return float(np.abs(q_dot[4 * fifth :]).max() / np.abs(q_dot[fifth : 2 * fifth]).max())

    assert swing(0.8 * low) < 0.5
    assert swing(1.25 * high) > 2.0


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
        growth[estimates] = growth_per_period(loop.system), math.log(away[2999] / away[2499]) / 500
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
    growth = growth_per_period(loop.system)
    assert 1.05 < growth < 1.2
    for _ in range(100):
        loop.step()
    change = np.abs(np.diff(loop.recording.signals(("multiplier",))["multiplier"]))
    assert math.log(change[80:].max() / change[40:60].max()) / 40 == pytest.approx(math.log(growth), rel=0.1)
    assert "the sampled loop is unstable" in (loop.warning or "")


@pytest.mark.parametrize("name", ["ur5-motion", "ur5-constrained", "ur5-hybrid", "ur5-impedance"])
def test_shipped_loops_contract_in_free_motion_as_in_contact(name: str) -> None:
    assert growth_per_period(assemble(shipped()[name])) < 1.0


@pytest.mark.parametrize("switching", ["discontinuous", "saturation"])
def test_the_motion_on_the_sliding_surface_is_judged_where_it_reads_a_contact(switching: str) -> None:
    """With 0.1 s of delay the force swings between 0 and 46 N, under a law that chatters, too; of a delay that is too
    long to be judged nothing is promised."""
    base = edited(shipped()["ur5-hybrid"], "controller.switching", switching)
    late = {delay: edited(base, "sensor.delay", delay) for delay in (0.02, 0.1, 0.101)}
    assert growth_per_period(assemble(late[0.02])) < 1.0 < growth_per_period(assemble(late[0.1])) < 1.01
    for delay in (0.1, 0.101):
        loop = run(edited(late[delay], "declared.force_error", 60.0), 3.0)
        force = loop.recording.signals(("multiplier",), t_from=2.0)["multiplier"]
        assert force.min() == 0.0
        assert force.max() > 40.0
        assert loop.standing.run.verdict == "nothing promised"
    assert growth_per_period(assemble(late[0.101])) == math.inf
    assert "is not known: the force sensor is late" in loop.warning
    assert 0.9 < growth_per_period(assemble(shipped()["ur5-motion-discontinuous"])) < 1.0


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("ur5-motion", {"target_model.B_m": [25000.0] * 6}),  # B_m T / M_m = 2.5
        ("ur5-motion", {}),
        ("ur5-constrained", {"sensor.ideal": True}),
    ],
)
def test_a_delay_of_a_reading_that_does_not_tell_of_the_arm_changes_nothing_of_the_judgement(
    name: str, fields: dict[str, object]
) -> None:
    prompt = shipped()[name]
    for path, value in fields.items():
        prompt = edited(prompt, path, value)
    late = edited(prompt, "sensor.delay", 0.2)
    growths = [growth_per_period(assemble(each)) for each in (prompt, late)]
    assert growths[0] == growths[1]
    assert (growths[0] > 1.0) == ("target_model.B_m" in fields)


def test_a_late_moment_is_no_late_force() -> None:
    """A contact in a point exerts no moment, on a spring and on a rigid surface behind a low-pass."""
    for name, fields in (("ur5-hybrid", {}), ("ur5-constrained", {"sensor.cutoff": 100.0})):
        prompt = with_values(shipped()[name], fields)
        late = edited(prompt, "sensor.moment_delay", 0.2)
        found = [sampled_loop(system := assemble(each), system.q_0, 0.0) for each in (prompt, late)]
        assert found[0].premises == found[1].premises
        assert found[0].force_factor == pytest.approx(found[1].force_factor, nan_ok=True)


@pytest.mark.parametrize(
    "fields", [{"controller.F_2": 1e4}, {"controller.F_2": 1e-3}, {"controller.F_2": [1e5, *[1.0] * 5]}]
)
def test_the_unit_of_z_changes_nothing_of_the_judgement(fields: dict[str, object]) -> None:
    """F_2 scales z and nothing else, so the poles stay."""
    usual, scaled = (assemble(each) for each in (load("ur5-hybrid"), with_values(load("ur5-hybrid"), fields)))
    poles = [np.sort_complex(np.linalg.eigvals(PeriodMap(each, Posture.of(each, each.q_0, 0.0)).jacobian()))
             for each in (usual, scaled)]  # fmt: skip
    np.testing.assert_allclose(poles[1], poles[0], atol=2e-5)
    assert growth_per_period(scaled) == pytest.approx(growth_per_period(usual), abs=1e-5)


def test_an_arm_that_may_leave_its_surfaces_is_judged_with_each_choice_of_them() -> None:
    """On one face of a body of two, as on a surface with the stiffness that the body has there."""
    coupled = {"coupling.K_e": [6000.0, 0.0, 0.0], "contact.B_e": 20.0, "sensor.delay": 0.004}
    scenario = with_values(in_mode(shipped()["planar3r-corner"], "impedance"), coupled)
    system = assemble(scenario)
    at = Posture.of(system, system.q_0, 0.0)
    maps = {touched: PeriodMap(system, at, touched).jacobian() for touched in touched_at_once(system)}
    assert list(maps) == [(0, 1), (), (0,), (1,)]
    stiffness = 1e4 - 6000.0**2 / 1e4
    alone = {"second.contact.kind": "free", "coupling.K_e": [0.0] * 3, "contact.K_e": stiffness}
    for place, others in ((0, {}), (1, {"surface": scenario.second.surface, "contact.B_e": 20.0 * 0.6**2})):
        lone = assemble(with_values(scenario, alone | others))
        expected = PeriodMap(lone, Posture.of(lone, system.q_0, 0.0)).jacobian()
        np.testing.assert_allclose(maps[place,], expected, atol=1e-7 * np.abs(expected).max())
    judged = sampled_loop(system, system.q_0, 0.0).premises[Premise.SAMPLED_LOOP]
    assert judged == pytest.approx(max(np.abs(np.linalg.eigvals(each)).max() for each in maps.values()), abs=2e-7)
    on_them = assemble(edited(shipped()["planar3r-corner"], "sensor.delay", 0.004))
    assert touched_at_once(on_them) == [(0, 1), (0,), (1,)]


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


@pytest.mark.parametrize("force", [200.0, 5.0])
def test_a_force_on_a_curved_surface_that_is_read_late_is_a_negative_damping(force: float) -> None:
    """The normal turns under the tool, and the law compensates the force in the direction of 20 ms ago."""
    base = shipped()["ur5-constrained"]
    before = assemble(base)
    x, y, z = before.observe(before.q_0, np.zeros(6), 0.0).estimate.p.tolist()
    ball = {"kind": "sphere", "origin": [x, y, z - 0.03], "radius": 0.03, "reference": [0.0, 0.0, 1.0]}
    fields = {
        "surface": ball, "force.value": force, "motion": "hold", "sensor.delay": 0.02,
        "target_model.M_m": [15.0, *5 * (10.0,)], "target_model.K_m": [0.0, *5 * (1000.0,)],
        "target_model.B_m": [100.0, *5 * (4.0,)], "controller.epsilon": 5.0, "controller.layer": 0.05,
        "truth.push": (3.0, 0.0, 0.0), "truth.push_start": 0.5, "truth.push_duration": 0.05,
        "truth.link_scaling": 1.0, "declared.link_scaling": 0.02,
    }  # fmt: skip
    loop = ClosedLoop.from_scenario(with_values(base, fields))
    growth = growth_per_period(loop.system)
    assert (growth > 1.0) == (force > 100.0)
    CompiledRun(loop).advance(3000)
    error = np.linalg.norm(loop.recording.signals(("e_r",))["e_r"], axis=1)
    early, late = error[1500:2000].max(), error[2500:].max()
    assert math.log(late / early) / 1000 == pytest.approx(math.log(growth), rel=0.2)
    assert ("the sampled loop is unstable" in (loop.warning or "")) == (force > 100.0)


@pytest.mark.parametrize("g", [30.0, 100.0])
def test_a_law_of_one_s_own_that_reads_z_is_judged_with_it(g: float) -> None:
    """s has an integral of the error in it: with a small gain on s the arm swings up slowly."""
    own_code.use([Path(law_of_s.__file__)])
    scenario = pressing("planar3r", 1e4, H, controller__law="of-s", simulation__substeps=8, contact__unilateral=False)
    scenario = edited(scenario, "controller.own.of-s.g", g)
    growth = growth_per_period(assemble(scenario))
    assert (growth > 1.0) == (g < 50.0)
    loop = ClosedLoop.from_scenario(edited(scenario, "force.value", 1e-5 if growth > 1.0 else 10.0))
    for _ in range(6000):
        loop.step()
    error = np.abs(loop.recording.signals(("e_r",))["e_r"]).max(axis=1)
    assert math.log(error[-600:].max() / error[-1800:-1200].max()) / 1200 == pytest.approx(math.log(growth), rel=0.15)
