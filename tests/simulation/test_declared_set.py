"""Truth against declaration: each inequality, and what each field does in the running loop."""

from __future__ import annotations

import re

import msgspec
import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import eigh

from app.scenario.data import edited, load, shipped
from app.scenario.declared_bounds import outside
from app.scenario.errors import ScenarioError
from app.scenario.schema import Declared, Scenario
from app.scenario.units import CARTESIAN
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from environments.sensors import ForceReader, ForceSensor


def changed(scenario: Scenario, fields: dict[str, object]) -> Scenario:
    for path, value in fields.items():
        scenario = edited(scenario, path, value)
    return scenario


@pytest.mark.parametrize(
    ("truth", "declared", "message"),
    [
        ({"truth.link_scaling": 0.85}, {"declared.link_scaling": 0.15}, "link scaling |0.85 − 1| = 0.15 > declared 0"),
        ({"truth.link_scaling": 1.15}, {"declared.link_scaling": 0.15}, "link scaling |1.15 − 1| = 0.15 > declared 0"),
        (
            {"truth.link_scaling": [1.1, 0.7, 1.2]},
            {"declared.link_scaling": 0.3},
            "link scaling of link 2 |0.7 − 1| = 0.3 > declared 0",
        ),
        ({"truth.rotor_scaling": 0.9}, {"declared.rotor_scaling": 0.1}, "rotor scaling |0.9 − 1| = 0.1 > declared 0"),
        (
            {"truth.link_centre": [[0.0, 0.0, 0.01], [0.03, -0.04, 0.0], [0.0, 0.0, 0.0]]},
            {"declared.link_centre": 0.05},
            "centre of mass of link 2 off by 0.05 m > declared 0 m",
        ),
        (
            {"truth.link_shape": [0.1, -0.1, 0.0, 0.0, 0.3, 0.0]},  # eigenvalues -0.1, 0.05 +- sqrt(0.05^2 + 0.3^2)
            {"declared.link_shape": 0.05 + 0.0925**0.5},
            "shape of the inertia off by 0.3541 > declared 0",
        ),
        ({"truth.payload_mass": 2.0}, {"declared.payload_mass": 2.0}, "payload 2 kg > declared 0 kg"),
        (
            {"truth.payload_mass": 1.0, "truth.payload_offset": [0.03, 0.0, -0.04], "declared.payload_mass": 1.0},
            {"declared.payload_offset": 0.05},
            "payload offset 0.05 m > declared 0 m",
        ),
        ({"truth.coulomb": 1.5}, {"declared.coulomb": 1.5}, "Coulomb friction 1.5 N·m > declared 0 N·m"),
        ({"truth.viscous": 0.2}, {"declared.viscous": 0.2}, "viscous friction 0.2 N·m·s/rad > declared 0 N·m·s/rad"),
        ({"truth.disturbance": 3.0}, {"declared.disturbance": 3.0}, "disturbance 3 N·m > declared 0 N·m"),
        (
            {"sensor.bias": [0.3, 0.0, -0.4], "sensor.noise": 0.1},
            {"declared.force_error": 0.9},
            "force error (bias + 4σ of noise) 0.9 N > declared 0 N",
        ),
    ],
)
def test_each_inequality_is_named_with_both_numbers_and_equality_is_inside(
    truth: dict[str, object], declared: dict[str, object], message: str
) -> None:
    scenario = changed(Scenario(), truth)
    assert outside(scenario, CARTESIAN) == (message,)
    assert outside(changed(scenario, declared), CARTESIAN) == ()
    (path, bound), *_ = declared.items()
    assert len(outside(edited(changed(scenario, declared), path, 0.99 * float(str(bound))), CARTESIAN)) == 1


def test_shipped_scenarios_are_inside_and_a_payload_that_is_not_there_has_no_place() -> None:
    for scenario in shipped().values():
        assert outside(scenario, CARTESIAN) == ()
    assert outside(edited(Scenario(), "truth.payload_offset", [1.0, 0.0, 0.0]), CARTESIAN) == ()


def test_noise_is_judged_behind_the_low_pass() -> None:
    """First-order low-pass of white noise, simulated as the sensor does it."""
    scenario = changed(Scenario(), {"sensor.noise": 1.0, "sensor.cutoff": 20.0})
    loop = ClosedLoop.from_scenario(scenario)
    readings = np.array([loop.state.reader.read(np.zeros(6))[:3] for _ in range(40_000)])[500:]
    spread = 4.0 * float(readings.std())
    assert outside(edited(scenario, "declared.force_error", 1.1 * spread), CARTESIAN) == ()
    assert len(outside(edited(scenario, "declared.force_error", 0.9 * spread), CARTESIAN)) == 1
    assert np.mean(np.linalg.norm(readings, axis=1) < spread) > 0.995


def test_a_low_pass_has_been_running_before_the_run_begins() -> None:
    """The first readings of many runs are no noisier than those at rest: in either engine they are the same numbers."""
    scenario = changed(load("ur5-hybrid"), {"sensor.noise": 1.0, "sensor.cutoff": 5.0, "declared.force_error": 0.55})
    assert outside(scenario, CARTESIAN) == ()
    sensor = ForceSensor(scenario.sensor, scenario.controller.period)
    errors = np.array([[ForceReader(sensor, seed).read(np.zeros(6))[:3]] for seed in range(400)])
    assert errors.std() == pytest.approx(sensor.noise_share, rel=0.1)
    by_steps, compiled = (ClosedLoop.from_scenario(scenario) for _ in range(2))
    for _ in range(30):
        by_steps.step()
    CompiledRun(compiled).advance(30)
    readings = [loop.recording.stretch()["F"] for loop in (by_steps, compiled)]
    np.testing.assert_allclose(*readings, rtol=1e-9, atol=1e-9)
    assert np.linalg.norm(readings[0][0]) < 0.55


def test_bias_and_noise_of_a_sensor_count_where_they_reach_the_reading() -> None:
    """The ideal reading of a surface without springs is the force of the period itself."""
    faulty = {"sensor.ideal": True, "sensor.noise": 1.0, "sensor.bias": [9.0, 0.0, 0.0]}
    heavy = {"second.contact.kind": "mass-damper-spring", "second.contact.M_e": 1.0}
    for name, more, known in (("ur5-constrained", {}, 0), ("ur5-hybrid", {}, 1), ("ur5-corner", heavy, 0)):
        scenario = changed(shipped()[name], more | faulty | {"simulation.leaving_domain": "flag"})
        assert sum(message.startswith("force error") for message in outside(scenario, CARTESIAN)) == known
        loop = ClosedLoop.from_scenario(scenario)
        for _ in range(50):
            loop.step()
        last = loop.recording.at(loop.t)
        assert (np.linalg.norm(last["F"] - last["F_true"]) > 1.0) == bool(known)


TRUE = {
    "truth.link_scaling": [1.3, 1.0, 0.8],
    "truth.link_centre": [[0.0, 0.0, 0.02], [0.01, 0.0, 0.0], [0.0, 0.0, -0.02]],
    "truth.link_shape": [0.0, 0.4, 0.0, 0.0, 0.0, 0.0],
    "truth.payload_mass": 2.0,
    "truth.payload_offset": [0.2, 0.0, 0.1],
    "truth.coulomb": 1.0,
    "truth.viscous": 1.0,
    "truth.disturbance": 5.0,
    "truth.disturbance_frequency": 3.0,
}
DECLARED = {
    "declared.link_scaling": 0.3,
    "declared.link_centre": 0.02,
    "declared.link_shape": 0.3,
    "declared.payload_mass": 2.0,
    "declared.payload_offset": 0.2,
    "declared.coulomb": 1.0,
    "declared.viscous": 1.0,
    "declared.disturbance": 5.0,
    "declared.force_error": 2.0,
    "declared.delta_C": "4 + 2*speed",
    "declared.delta_G": 15.0,
    "declared.delta_f": "8 + 0.1*t",
}
LOADED = {"truth.payload_mass": 1.0, "truth.disturbance": 1.0, "declared.payload_mass": 1.0, "controller.d": 30.0}


@pytest.fixture(scope="module")
def base() -> Scenario:
    return changed(shipped()["planar3r-hybrid"], LOADED)


def run_on(base: Scenario, fields: dict[str, object]) -> ClosedLoop:
    loop = ClosedLoop.from_scenario(base)
    for step in range(120):
        if step == 60:
            loop.edit(changed(base, fields))
        loop.step()
    assert len(loop.recording.rows()) == 120  # an edit of the truth does not begin anew
    return loop


@pytest.mark.parametrize("field", TRUE)
def test_each_field_of_the_truth_acts_at_once(base: Scenario, field: str) -> None:
    q = [run_on(base, fields).recording.signals(("q",))["q"] for fields in ({}, {field: TRUE[field]})]
    assert np.array_equal(q[0][:60], q[1][:60])
    assert np.abs(q[0][-1] - q[1][-1]).max() > 1e-7


@pytest.mark.parametrize("field", DECLARED)
def test_each_declared_bound_raises_what_the_theorem_needs(base: Scenario, field: str) -> None:
    """And d with it, in the running loop."""
    before, after = (run_on(base, fields).view().live for fields in ({}, {field: DECLARED[field]}))
    assert after["d_required"] > before["d_required"] + 0.01
    assert after["d"] > before["d"] + 0.01


STATED = {
    "declared.delta_M": 0.4,
    "declared.delta_C": "2*speed + 0.01",
    "declared.delta_G": 6.0,
    "declared.delta_f": 2.0,
}


@pytest.mark.parametrize("engine", ["step", "compiled"])
@pytest.mark.parametrize(
    ("tighter", "message"),
    [
        ({}, None),
        ({"declared.delta_M": 0.02}, "‖ΔM‖"),
        ({"declared.least_inertia": 1.0}, "largest share c with M ≥ c M̂"),
        ({"declared.delta_C": "0.001*speed"}, "‖ΔC‖"),
        ({"declared.delta_G": 0.1}, "‖ΔG‖"),
        ({"declared.delta_f": 0.01}, "‖f̃‖"),
    ],
)
def test_a_run_judges_whether_the_true_arm_is_within_stated_bounds(
    tighter: dict[str, object], message: str | None, engine: str
) -> None:
    """Whatever is declared of the links: then these are not judged. The numbers are those of Pinocchio's true arm."""
    lighter = {"declared.link_scaling": 0.0, "truth.link_scaling": 0.9, "controller.gain": "constant"}
    base = changed(shipped()["planar3r-hybrid"], STATED | lighter)
    loop = ClosedLoop.from_scenario(changed(base, {"truth.disturbance": 1.0, "truth.viscous": 0.2} | tighter))
    run = CompiledRun(loop) if engine == "compiled" else loop
    run.advance(100) if isinstance(run, CompiledRun) else [loop.step() for _ in range(100)]
    standing, errors = loop.standing, loop.state.evaluation.part("errors")
    assert [each.split(" = ")[0] for each in standing.outsiders] == ([] if message is None else [message])
    finding = next(each for each in standing.findings if each.premise == "declared")
    assert (finding.failed is None) == (message is None)
    assert message is None or (standing.run.verdict == "nothing promised" and message in standing.now.because)

    row = loop.recording.signals(("t", "q", "q_dot"))
    t, q, q_dot = (row[name][-1] for name in ("t", "q", "q_dot"))
    system, true = loop.system, loop.system.plant.model
    believed, known = system.nominal.evaluate(q, q_dot), true.createData()
    M, C = pin.crba(true, known, q).copy(), pin.computeCoriolisMatrix(true, known, q, q_dot).copy()
    G = pin.computeGeneralizedGravity(true, known, q)
    expected = (
        np.linalg.norm(M - believed.M_hat, 2),
        np.linalg.norm(C - believed.C_hat, 2),
        np.linalg.norm(G - believed.G_hat),
        np.linalg.norm(system.plant.truth.torque(q_dot, float(t))),
        float(eigh(M, believed.M_hat, eigvals_only=True)[0]),
    )
    assert tuple(errors) == pytest.approx(expected, rel=1e-6, abs=1e-9)

    unstated = msgspec.structs.replace(loop.system.scenario, declared=Declared(link_scaling=0.1, viscous=0.2))
    loop.edit(edited(unstated, "declared.disturbance", 1.0))
    loop.step()
    assert loop.standing.outsiders == ()
    assert np.isnan(loop.state.evaluation.read().seen.estimate.stated).all()


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("declared.delta_M", "speed", '"speed" at character 1 is unknown; allowed: numbers, away, pi'),
        ("declared.delta_C", "__import__(1)", '"__import__" at character 1 is unknown'),
        ("declared.delta_G", "away - 1", "declared.delta_G: 'away - 1' is -1 at away = 0; allowed: finite values >= 0"),
        ("declared.delta_f", "1/(speed - 5)", "allowed: finite values >= 0 for speed from 0 to 20, t from 0 to"),
        ("declared.delta_M", -1.0, "declared.delta_M"),
        ("truth.link_centre", [[0.0, 0.0, 0.0]] * 2, "allowed: 3 numbers, or 3 rows of 3, one per link"),
        ("truth.link_shape", [0.0, 0.0], "allowed: 6 numbers, or 3 rows of 6, one per link"),
        ("truth.link_shape", [0.0, -1.0, 0.0, 0.0, 0.0, 0.0], "a link with 0 of its inertia about an axis"),
        ("declared.link_centre", 0.9, "their bound E would leave some arm no inertia"),
    ],
)
def test_a_bound_or_a_link_that_makes_no_sense_is_refused_with_a_sentence(
    path: str, value: object, message: str
) -> None:
    with pytest.raises(ScenarioError, match=re.escape(message)):
        ClosedLoop.from_scenario(edited(shipped()["planar3r-hybrid"], path, value))
