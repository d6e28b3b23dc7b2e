"""Two and three surfaces at once: coordinates, contacts, the law and its premises, against closed forms."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from app.analysis.metrics import metrics_of
from app.analysis.steady_force import steady_force_error
from app.scenario.data import edited, from_plain, load, shipped, to_plain
from app.scenario.errors import IrregularCorner, ScenarioError
from app.scenario.schema import Scenario
from app.scenario.units import CARTESIAN
from app.session.adaptation_sentence import adaptation_sentence
from app.session.changes import in_mode, possible, with_control, with_further
from app.session.headless_run import simulate
from app.session.ways_out import way_out
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from environments.surfaces.corner import Corner
from environments.surfaces.form import SurfaceMotion
from tests.support.arms import answered
from tests.support.surfaces import cylinder, plane, sphere

SWAYS = SurfaceMotion(direction=(0.6, 0.0, 0.8), amplitude=0.03, frequency=1.7)
NEAR = np.array([0.5, 0.1, 0.2])


def corner(number: int, motion: SurfaceMotion = SWAYS) -> Corner:
    """Oblique surfaces, each with its own motion, a few centimetres from NEAR."""
    surfaces = (
        plane(NEAR + 0.03, np.array([0.28, 0.0, -0.96]), motion),
        cylinder(
            NEAR + np.array([0.02, 0.3, 0.0]), np.array([0.9, 0.1, 0.3]), np.array([0.0, -1.0, 0.1]), 0.28, "outside"
        ),
        sphere(NEAR + np.array([0.25, 0.0, 0.05]), np.array([-1.0, 0.2, 0.0]), 0.22, "outside", motion),
    )
    return Corner(surfaces[:number], NEAR)


@pytest.mark.parametrize("number", [2, 3])
def test_coordinates_are_those_of_each_surface_and_their_derivatives_are_exact(number: int) -> None:
    found, p, t, h = corner(number), NEAR + np.array([0.01, -0.02, 0.015]), 0.37, 1e-5
    chart = found.chart(p, t)
    for i, surface in enumerate(found.surfaces):
        alone = surface.chart(p, t)
        assert (chart.g[i], *chart.G[i], chart.g_tt[i]) == (alone.g[0], *alone.G[0], alone.g_tt[0])
    sides = [(found.chart(p + e, t), found.chart(p - e, t)) for e in h * np.eye(3)]
    sides.append((found.chart(p, t + h), found.chart(p, t - h)))
    G, G_p, g_tt = (
        np.stack([(getattr(a, of) - getattr(b, of)) / (2 * h) for a, b in sides], axis=-1) for of in ("g", "G", "g_t")
    )
    np.testing.assert_allclose(np.column_stack([chart.G, chart.g_t]), G, atol=1e-8)
    np.testing.assert_allclose(np.concatenate([chart.G_p, chart.G_t[:, :, None]], axis=2), G_p, atol=1e-7)
    np.testing.assert_allclose(np.column_stack([chart.G_t, chart.g_tt]), g_tt, atol=1e-7)
    np.testing.assert_allclose(found.point(chart.g, t), p, atol=1e-12)


def test_surfaces_that_are_parallel_at_the_tool_make_no_corner() -> None:
    with pytest.raises(ValueError, match="not independent; allowed: surfaces that meet at an angle"):
        Corner((plane(NEAR, np.array([0.0, 0.0, -1.0])), plane(NEAR, np.array([0.02, 0.0, -1.0]))), NEAR)


CORNERS = ("ur5-corner", "ur5-corner-coupled", "ur5-corner-rigid", "ur5-groove-moving", "planar3r-corner")


@pytest.mark.slow  # long simulations
@pytest.mark.parametrize("name", CORNERS)
def test_shipped_corners_are_pressed_and_followed_by_a_heavier_arm(name: str) -> None:
    loop, _ = simulate(load(name))
    found, rigid = metrics_of(loop), loop.system.plant.nature.rigid
    assert loop.stopped is None
    assert found.motion_error_tail is None or found.motion_error_tail < 1e-4  # None: the tool only turns
    assert found.force_error_tail is not None
    assert found.force_error_tail < (0.3 if rigid else 0.1)
    last = loop.recording.at(loop.t)
    assert (last["multiplier"][0], last["multiplier_2"][0]) == pytest.approx((20.0, 10.0), abs=0.3)
    if rigid:
        assert found.constraint_violation is not None
        assert found.constraint_violation < 1e-14
    assert found.promise.verdict == "holds"


def bilateral(name: str = "ur5-corner", **further: object) -> Scenario:
    """A corner of surfaces that also pull, for an arm that is known exactly, without the torque's slack."""
    scenario = load(name)
    fields: dict[str, object] = {
        "truth.link_scaling": 1.0,
        "declared.link_scaling": 0.0,
        "contact.unilateral": False,
        "second.contact.unilateral": False,
        "motion": {"kind": "hold"},
        **further,
    }
    for path, value in fields.items():
        scenario = edited(scenario, path, value)
    return scenario


COUPLED = {
    "M_m": [[12.0, 3.0, 0, 0, 0, 0], [3.0, 8.0, 0, 0, 0, 0], *(np.diag([10.0] * 6)[2:].tolist())],
    "B_m": [[700.0, 90.0, 0, 0, 0, 0], [90.0, 420.0, 0, 0, 0, 0], *(np.diag([400.0] * 6)[2:].tolist())],
    "K_m": [[900.0, 200.0, 0, 0, 0, 0], [200.0, 500.0, 0, 0, 0, 0], *(np.diag([4000.0] * 6)[2:].tolist())],
}
OBLIQUE = {"kind": "plane", "origin": [0.021, 0.177, -0.035], "normal": [0.3, 0.8, -0.5]}


@pytest.mark.parametrize(("between", "believed_between"), [(0.0, 0.0), (2500.0, -1500.0), (-2000.0, 0.0)])
def test_normal_errors_obey_35_with_full_matrices_and_settle_at_37(between: float, believed_between: float) -> None:
    """M_m1 e'' + B_m1 e' + (K_m1 + K_e) e = -(K_e - K_e_hat) r_fd, as (34) and (37) have it, for normals that are not
    orthogonal, a stiffness that is believed wrongly, and matrices that couple both, those of the surfaces, too; the
    sampled loop comes nearer to it as its period becomes shorter."""
    apart, coupling = [], {"K_e": [between, 0.0, 0.0], "K_e_hat": [believed_between, 0.0, 0.0]}
    for period in (1e-3, 5e-4):
        given = {"target_model": COUPLED, "second.surface": OBLIQUE, "controller.period": period, "coupling": coupling}
        believed = {"controller.K_e_hat": 8000.0, "second.K_e_hat": 7000.0, "second.contact.K_e": 5000.0}
        loop = ClosedLoop.from_scenario(bilateral(**given, **believed))
        system, model = loop.system, loop.system.controller.model
        K_e, K_e_hat = (
            np.array([[first, beside], [beside, second]])
            for first, second, beside in ((1e4, 5e3, between), (8e3, 7e3, believed_between))
        )
        f_nd = np.array([20.0, 10.0])
        r_fd = np.linalg.solve(K_e_hat, f_nd)
        M, B, K = (matrix[:2, :2] for matrix in (model.M_m, model.B_m, model.K_m))
        e_0 = system.observe(system.q_0, np.zeros(6), 0.0)[1].r[:2] - r_fd
        A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K + K_e), -np.linalg.solve(M, B)]])
        rest = np.concatenate([-np.linalg.solve(K + K_e, (K_e - K_e_hat) @ r_fd), np.zeros(2)])
        for _ in range(round(0.4 / period)):
            loop.advance()
        record = loop.recording.signals(("t", "e_r", "multiplier", "multiplier_2"))
        rows = slice(0, None, round(0.01 / period))
        exact = [
            (expm(A * t) @ (np.concatenate([e_0, np.zeros(2)]) - rest) + rest)[:2] for t in record["t"][rows].tolist()
        ]
        apart.append(np.abs(record["e_r"][rows, :2] - exact).max())
        assert np.abs(e_0).max() > 0.01
    assert apart[0] < 5e-4
    assert apart[1] / apart[0] == pytest.approx(0.5, abs=0.15)
    error = (np.eye(2) - K_e @ np.linalg.inv(K + K_e)) @ (K_e - K_e_hat) @ r_fd  # (37)
    settled = model.steady_forces(K_e, r_fd, f_nd, np.zeros(2))
    np.testing.assert_allclose(settled - f_nd, error, rtol=1e-12)
    loop, _ = simulate(edited(loop.system.scenario, "simulation.duration", 3.0))
    last = loop.recording.at(loop.t)
    np.testing.assert_allclose([last["multiplier"][0], last["multiplier_2"][0]], settled, rtol=1e-3)
    predicted = steady_force_error(loop.system, last["r_d"], last["F_cd"], last["s"])
    assert predicted == pytest.approx(np.linalg.norm(error), rel=1e-3)
    in_contact = np.linalg.eigvals(A)
    found = loop.sampled.model
    assert max(np.abs(found - pole).min() / abs(pole) for pole in in_contact) < 1e-6


def test_friction_along_the_edge_is_not_taken_for_a_normal_force() -> None:
    rough = {"contact.friction_coulomb": 0.3, "second.contact.friction_coulomb": 0.2, "second.surface": OBLIQUE}
    line = {"kind": "line", "displacement": [0.08], "period": 4.0}
    declared = {"declared.coulomb": 2.0}
    loop, _ = simulate(edited(bilateral(**rough, **declared, motion=line), "simulation.duration", 2.0))
    record = loop.recording.signals(("F_c", "multiplier", "multiplier_2", "F", "t"), t_from=1.2)
    normals = np.array([each.chart(NEAR, 0.0).G[0] for each in loop.system.surfaces])
    across = np.linalg.svd(normals)[2][2]
    assert np.abs(record["F"] @ across).min() > 3.0
    np.testing.assert_allclose(record["F_c"][:, 0], record["multiplier"], atol=0.05)
    np.testing.assert_allclose(record["F_c"][:, 1], record["multiplier_2"], atol=0.05)


def test_a_path_may_lead_along_one_surface_while_the_force_on_the_other_is_controlled() -> None:
    scenario = with_control(load("ur5-corner"), "second.control", "path")
    scenario = edited(scenario, "motion", {"kind": "point-to-point", "displacement": [0.005, 0.05], "duration": 1.0})
    loop, _ = simulate(edited(scenario, "simulation.duration", 2.0))
    system, last = loop.system, loop.recording.at(loop.t)
    assert (system.m, [coordinate.name for coordinate in system.coordinates[:3]]) == (1, ["φ₁", "φ₂", "ψ"])
    assert last["multiplier"][0] == pytest.approx(20.0, abs=0.1)
    begun = system.observe(system.q_0, np.zeros(6), 0.0)[1].r
    np.testing.assert_allclose(last["r"][1:3], begun[1:3] + np.array([0.005, 0.05]), atol=1e-4)


def test_each_massive_surface_is_left_by_itself() -> None:
    """Multipliers of (28) are never negative, and each one that is not zero obeys its own equation: the tool is within
    both, and is torn from one of them."""
    scenario = load("ur5-corner")
    for path, value in {
        "contact": {"kind": "mass-damper-spring", "K_e": 2000.0, "M_e": 2.0, "B_e": 5.0},
        "second.contact": {"kind": "mass-damper-spring", "K_e": 1000.0, "M_e": 1.0, "B_e": 3.0},
        "second.surface": OBLIQUE,
        "surface.origin": [0.0, 0.0, 0.185],
        "simulation.integrator": "semi-implicit-euler",
    }.items():
        scenario = edited(scenario, path, value)
    system, random, h = assemble(scenario), np.random.default_rng(1), 1e-4
    seen = set()
    for _ in range(40):
        q_dot, tau = random.uniform(-0.3, 0.3, 6), 60.0 * random.standard_normal(6)
        state = system.plant.start(system.q_0 + random.uniform(-0.02, 0.02, 6), q_dot, 0.0)
        multipliers, q_ddot = answered(system, state, tau)
        q = state.views.q

        def phi(t: float, q: np.ndarray = q, q_dot: np.ndarray = q_dot, q_ddot: np.ndarray = q_ddot) -> np.ndarray:
            p = system.nominal.evaluate(q + t * q_dot + 0.5 * t * t * q_ddot, q_dot).p
            return np.array([each.chart(p, t).g[0] for each in system.surfaces])

        phi_dot, phi_ddot = (phi(h) - phi(-h)) / (2 * h), (phi(h) - 2 * phi(0.0) + phi(-h)) / h**2
        pull = np.array([2.0, 1.0]) * phi_ddot + np.array([5.0, 3.0]) * phi_dot + np.array([2e3, 1e3]) * phi(0.0)
        acts = multipliers[:2] != 0.0
        np.testing.assert_allclose(multipliers[:2][acts], pull[acts], atol=1e-3)
        assert (multipliers >= 0.0).all()
        left = ~acts & (phi(0.0) > 0.0)
        assert (pull[left] < 1e-3).all()
        seen.add((*acts.tolist(), *left.tolist()))
    assert {state[:2] for state in seen} == {(True, True), (True, False), (False, True), (False, False)}
    assert any(left for state in seen for left in state[2:])


def sampled(M_m1: float) -> ClosedLoop:
    """A rigid corner with this inertia of the model across both surfaces, nudged."""
    constant = {"controller.law": "computed-torque", "target_model": {"M_m": [M_m1, M_m1, 10.0, 10.0, 10.0, 10.0]}}
    nudge = {"truth.push": [0.0, 3.0, -3.0], "truth.push_start": 0.0, "truth.push_duration": 0.01}
    return ClosedLoop.from_scenario(bilateral("ur5-corner-rigid", **constant, **nudge, **{"sensor.ideal": False}))


def test_the_force_loop_of_a_corner_swings_up_where_its_factor_says() -> None:
    low, high = 1.0, 30.0
    for _ in range(40):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if sampled(middle).sampled.force_factor < -1.0 else (low, middle)
    settles, swings = sampled(1.1 * high), sampled(0.9 * low)
    assert -1.0 < settles.sampled.force_factor < -0.8
    assert swings.sampled.force_factor < -1.1
    changes = []
    for loop in (settles, swings):
        for _ in range(150):
            loop.advance()
        record = loop.recording.signals(("multiplier", "multiplier_2"), t_from=0.02)
        changes.append([np.abs(np.diff(record[name][-20:])).max() for name in record])
    assert max(changes[0]) < 0.1
    assert max(changes[1]) > 100.0


def test_two_planes_make_a_corner_from_the_angle_on_that_the_documentation_says() -> None:
    text = (Path(__file__).parents[2] / "docs" / "symbols.md").read_text(encoding="utf-8")
    said = re.search(r"they are refused at an angle below ([\d.]+) rad", text)
    assert said is not None
    least = float(said[1])

    def meet(angle: float) -> Corner:
        normals = np.array([0.0, 0.0, -1.0]), np.array([0.0, np.sin(angle), -np.cos(angle)])
        return Corner(tuple(plane(NEAR, normal, SurfaceMotion()) for normal in normals), NEAR)

    for beside in (0.0, np.pi):  # normals that look the same way, and opposite ways
        assert len(meet(beside + least + 0.0005).surfaces) == 2
        with pytest.raises(ValueError, match="are not independent"):
            meet(beside + least - 0.0005)


def test_a_lost_contact_is_named() -> None:
    pulled = load("ur5-corner-rigid")
    for path, value in {"truth.push": [0.0, -300.0, 0.0], "truth.push_start": 0.05}.items():
        pulled = edited(pulled, path, value)
    loop, _ = simulate(edited(pulled, "simulation.duration", 0.5))
    assert loop.stopped is not None
    assert "contact lost, the second surface would have to pull (λ = -" in loop.stopped
    torn = edited(edited(load("ur5-corner"), "truth.push", [0.0, -60.0, 0.0]), "truth.push_start", 1.5)
    loop, _ = simulate(edited(torn, "simulation.duration", 2.0))
    assert loop.warning is not None
    assert "the tool has left the second surface" in loop.warning


@pytest.mark.parametrize(
    ("name", "path", "value", "message"),
    [
        ("ur5-corner", "second.contact.kind", "rigid", "second.contact.kind: 'rigid' in hybrid mode; allowed: elastic"),
        ("ur5-corner", "second.surface.normal", [0, 0, -1], "second.surface.normal: the normals [[0.0, 0.0, -1.0], [0"),
        ("ur5-corner-rigid", "second.surface.normal", [0, 0, 1], "second.surface.normal: the normals [[0.0, 0.0, -1.0"),
        ("ur5-corner", "second.surface.normal", [0, 0, -1], "are not independent; allowed: surfaces that meet at an"),
        (
            "ur5-corner",
            "second.surface.origin",
            [0, 3, 0],
            "second.surface: out of the arm's reach, 2.89 m ahead of th",
        ),
        ("ur5-corner", "second.surface.origin", [0, 3, 0], "by second.surface.origin or robot.posture"),
        ("ur5-corner", "surface.origin", [0, 0, -3], "surface: out of the arm's reach, 3.18 m ahead of the tool at"),
        ("ur5-corner-rigid", "second.surface.origin", [0, 3, 0], "second.surface: the tool cannot be brought onto the"),
        ("ur5-corner", "force.kind", "sine", "force.kind: 'sine'; allowed: constant, step, sinusoid"),
        ("ur5-corner", "second.force.kind", "sine", "second.force.kind: 'sine'; allowed: constant, step, sinusoid"),
        ("ur5-corner", "second.surface.kind", "cube", "second.surface.kind: 'cube'; allowed: plane, cylinder, sphere"),
        ("ur5-corner", "third.force.kind", "sine", "third.force.kind: 'sine'; allowed: constant, step, sinusoid"),
        ("ur5-corner", "third.surface.kind", "cube", "third.surface.kind: 'cube'; allowed: plane, cylinder, sphere"),
        (
            "ur5-corner",
            "second.surface.normal",
            [0, 0, 0],
            "second.surface.normal: 0, 0, 0 is too short for a direction; allowed: three numbers that are not all 0",
        ),
        ("ur5-corner", "second.force.value", -5.0, "second.force.value: -5 N, but the surface only pushes (second.con"),
        ("ur5-corner", "second.contact.B_e", 1e5, "second.contact.B_e: 100000 N·s/m is too stiff for 1 step(s)"),
        ("ur5-corner-rigid", "second.control", "path", "second.control: 'path' on a rigid surface; allowed: 'force'"),
        ("planar3r-corner", "third.contact.kind", "elastic", "the surface number 3; allowed with this arm: 'free'"),
        ("ur5-motion", "second.contact.kind", "elastic", "second.contact.kind: 'elastic' without a first surface"),
    ],
)
def test_refusals_name_the_field_of_the_further_surface(name: str, path: str, value: object, message: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        assemble(edited(load(name), path, value))
    assert message in str(refused.value)


def test_the_third_of_three_surfaces_is_named_where_it_makes_no_corner_with_the_others() -> None:
    data = to_plain(load("ur5-corner"))
    data["third"] = {**data["second"], "surface": {**data["second"]["surface"], "normal": [0.0, 1.0, 1.0]}}
    with pytest.raises(IrregularCorner, match=r"^third\.surface\.normal: the normals .* of the 3 surfaces"):
        assemble(from_plain(data))


def test_a_third_surface_follows_a_second_one_whose_force_is_controlled() -> None:
    data = to_plain(load("ur5-corner"))
    data["second"]["control"] = "path"
    data["third"] = {**data["second"], "control": "force"}
    with pytest.raises(ScenarioError, match=r"third.control: 'force' after a surface with 'path'"):
        assemble(from_plain(data))


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, s in shipped().items() if s.contact.nature.touches])
def test_a_further_surface_can_be_added_to_any_scenario_in_contact_and_taken_away_again(name: str) -> None:
    before = load(name)
    if before.second.present:
        before = edited(before, "second.contact.kind", "free")
    asked = with_further(before, "second", "elastic")
    loop = possible(asked, ClosedLoop.from_scenario)
    assert len(loop.system.surfaces) == (1 if before.contact.nature.rigid and loop.system.layout.n == 2 else 2)
    for _ in range(150):
        loop.advance()
    assert loop.stopped is None
    alone = with_further(loop.system.scenario, "second", "free")
    assert len(possible(alone, assemble).surfaces) == 1


def test_a_corner_that_the_arm_cannot_reach_has_a_way_out() -> None:
    parallel = edited(load("ur5-corner"), "second.surface.normal", [0.0, 0.0, -1.0])
    with pytest.raises(IrregularCorner) as refused:
        assemble(parallel)
    out = way_out(parallel, refused.value)
    assert out is not None
    assert out.title == "Take the second surface away"
    assert out.scenario is not None
    done = possible(out.scenario, assemble).scenario
    assert adaptation_sentence(parallel, done, CARTESIAN) == "Adapted: second surface taken away."


@pytest.mark.slow  # long simulations
def test_three_surfaces_hold_the_tool_in_a_point_and_each_gets_its_force() -> None:
    scenario = edited(load("ur5-corner"), "motion", {"kind": "hold"})
    scenario = edited(with_further(scenario, "third", "elastic"), "third.force.value", 15.0)
    loop, _ = simulate(edited(scenario, "simulation.duration", 3.0))
    last = loop.recording.at(loop.t)
    forces = [last[name][0] for name in ("multiplier", "multiplier_2", "multiplier_3")]
    assert forces == pytest.approx([20.0, 10.0, 15.0], abs=0.1)
    assert metrics_of(loop).promise.verdict == "holds"
    in_rigid = possible(in_mode(loop.system.scenario, "constrained"), ClosedLoop.from_scenario)
    assert in_rigid.system.m == 3
