"""Blends between target models: the note's theorems, the certificate against eigenvalues, the loop, the page."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import numpy as np
import pytest

from app.dashboard.widgets.fields.model_fields import blending, model_edit
from app.dashboard.widgets.target_model.model_checks import blend_html
from app.evidence import blend as section
from app.evidence.blend import NOTE, diagonal_lyapunov
from app.scenario.data import edited, from_toml, shipped, with_values
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.changes import blending_to
from app.session.commands import Blend, Edit
from app.session.headless_run import simulate, write
from app.session.runner import Runner
from app.session.timeline import Timeline
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from controllers.blend import axis_matrix, blended, certify, shared_sliding
from controllers.dominance import By, dominates, hurwitz_on_hull, schur_on_hull
from controllers.segment import _bialternate, rightmost
from controllers.target_model import InvalidGain, TargetModel

ALPHAS = np.linspace(0.0, 1.0, 401)
TO = {"B_m": [300.0, 600.0, 500.0], "K_m": [0.0, 6000.0, 5000.0]}


def abscissa(A: np.ndarray) -> float:
    """The largest real part of the eigenvalues of one or several matrices (..., n, n)."""
    return float(np.linalg.eigvals(A).real.max())


def disturbing_scenario() -> tuple[Scenario, Scenario]:
    """Two stable models with unstable ones between them, in the x-y plane of a UR5's impedance: where it begins, and
    one with the model that it is led to."""
    scenarios = []
    for model in section.disturbing():
        matrices = {}
        for name, rest in (("M_m", 10.0), ("B_m", 400.0), ("K_m", 2000.0)):
            whole = rest * np.eye(6)
            whole[:2, :2] = getattr(model, name)
            matrices[name] = whole.tolist()
        scenarios.append(edited(shipped()["ur5-impedance"], "target_model", matrices))
    return scenarios[0], scenarios[1]


def test_the_example_of_the_note() -> None:
    A_0, A_1 = NOTE
    np.testing.assert_allclose(0.5 * (A_0 + A_1), [[0.4, 0.4], [0.55, 0.55]])  # its formula at alpha = 1/2
    assert dominates(np.eye(2) - A_1, np.eye(2) - A_0, "rows")
    assert not dominates(np.eye(2) - A_0, np.eye(2) - A_1, "rows")
    assert schur_on_hull([A_0, A_1], "rows")
    assert not schur_on_hull([A_1, A_0], "rows")
    assert max(np.abs(np.linalg.eigvals((1 - a) * A_0 + a * A_1)).max() for a in ALPHAS) < 1.0
    (low_0, high_0), (low_1, high_1) = diagonal_lyapunov(A_0), diagonal_lyapunov(A_1)
    assert low_0 < high_0 < low_1 < high_1  # "there exist no diagonal-type Liapunov function" for both
    for A, (low, high) in zip(NOTE, (diagonal_lyapunov(A) for A in NOTE), strict=True):
        for x, falls in ((0.99 * low, False), (np.sqrt(low * high), True), (1.01 * high, False)):
            D = np.diag([1.0, x])
            assert (np.linalg.eigvalsh(A.T @ D @ A - D)[-1] < 0.0) == falls


@pytest.mark.parametrize("by", ["rows", "columns"])
def test_theorem_4_holds_for_random_matrices_and_gives_a_common_norm(by: By) -> None:
    rng, certified = np.random.default_rng(4), 0
    for _ in range(1500):
        n, N = rng.integers(2, 6), rng.integers(1, 4)
        A = [rng.random((n, n)) * (rng.random((n, n)) < 0.7) for _ in range(N + 1)]
        for k, A_k in enumerate(A):
            if k:
                A_k[:] = A[0] * np.where(rng.random((n, n)) < 0.02, 1.3, rng.random((n, n)))
            np.fill_diagonal(A_k, 0.0)
        strong = rng.uniform(0.5, 3.0, n)
        factors = [rng.uniform(0.2, 5.0, n) for _ in A]
        A = [
            (factor[:, None] if by == "rows" else factor) * (A_k - np.diag(strong))
            for factor, A_k in zip(factors, A, strict=True)
        ]
        if not hurwitz_on_hull(A, by):
            continue
        certified += 1
        weights = rng.dirichlet(np.full(N + 1, 0.5), 20)
        assert abscissa(np.tensordot(weights, A, 1)) < 0.0
        d = np.linalg.solve(-A[0] if by == "rows" else -A[0].T, np.ones(n))
        assert (d > 0.0).all()
        for A_k in A:  # the same d for all: sum_j a_ij d_j < 0, a norm that falls along each of them
            assert ((A_k @ d if by == "rows" else d @ A_k) < 0.0).all()
    assert 200 < certified < 1400


def test_dominance_is_what_theorem_4_needs() -> None:
    A_0, A_1 = np.array([[-1.0, 0.5], [0.1, -1.0]]), np.array([[-1.0, 0.1], [20.0, -3.0]])
    assert max(abscissa(A_0), abscissa(A_1)) < 0.0
    assert abscissa(0.5 * (A_0 + A_1)) > 0.0
    assert not any(hurwitz_on_hull(pair, by) for pair in ([A_0, A_1], [A_1, A_0]) for by in ("rows", "columns"))


def test_the_rightmost_eigenvalue_is_found_where_samples_miss_it() -> None:
    eps, at, width = 1e-4, 0.3333, 1e-3
    A_0, A_1 = (np.array([[-eps, alpha - at], [at + width - alpha, -eps]]) for alpha in (0.0, 1.0))
    found = rightmost(A_0, A_1)
    assert found.alpha == pytest.approx(at + 0.5 * width, abs=1e-5)
    assert found.eigenvalue == pytest.approx(0.5 * width - eps, rel=1e-4)
    assert rightmost(A_0 - 1e-3 * np.eye(2), A_1 - 1e-3 * np.eye(2)).at_most < 0.0


def test_the_rightmost_eigenvalue_of_random_segments() -> None:
    rng = np.random.default_rng(5)
    for _ in range(150):
        n = rng.integers(2, 8)
        A_0, A_1 = rng.normal(size=(2, n, n))
        found = rightmost(A_0, A_1)
        sampled = np.linalg.eigvals(A_0 + ALPHAS[:, None, None] * (A_1 - A_0)).real.max()
        assert sampled <= found.at_most
        assert found.eigenvalue.real <= found.at_most <= found.eigenvalue.real + 1e-4
        assert abscissa(A_0 + found.alpha * (A_1 - A_0)) == pytest.approx(found.eigenvalue.real, abs=1e-9)
    A = rng.normal(size=(4, 4))
    values = np.linalg.eigvals(A)
    sums = [values[i] + values[j] for i in range(4) for j in range(i)]
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(_bialternate(A))), np.sort_complex(sums), atol=1e-9)


def test_axes_in_sliding_coordinates() -> None:
    beta, kappa, sliding = 30.0, 125.0, 10.0
    T = np.array([[1.0, 0.0], [sliding, 1.0]])
    companion = np.array([[0.0, 1.0], [-kappa, -beta]])
    np.testing.assert_allclose(axis_matrix(beta, kappa, sliding), T @ companion @ np.linalg.inv(T))
    assert shared_sliding((30.0, 125.0), (12.0, 27.0)) == pytest.approx(np.sqrt(5.0 * 9.0))  # 5 ... 25 and 3 ... 9
    assert np.isnan(shared_sliding((30.0, 125.0), (4.0, 3.0)))  # 1 ... 3
    assert np.isnan(shared_sliding((30.0, 125.0), (12.0, 40.0)))  # underdamped


@pytest.mark.slow
def test_no_unstable_blend_is_certified() -> None:
    counts = section.coupled(3, 4, 120)
    assert counts["wrong"] == 0
    assert counts["refused"] > 5
    assert counts["eigenvalues"] > 50
    of_axes = section.decoupled(3, 300)
    assert of_axes["wrong"] == 0
    assert of_axes["theorem 4"] > 75


def test_a_blend_is_one_of_what_acts() -> None:
    rng = np.random.default_rng(1)
    start, end = (
        TargetModel(*(X @ X.T + np.eye(3) for X in rng.normal(size=(3, 3, 3))), np.diag([1.0, 0.5, 0.0]))
        for _ in range(2)
    )
    half = blended(start, end, 0.25)
    for name in ("B_m", "K_m", "K_f"):
        sides = [np.linalg.solve(model.M_m, getattr(model, name)) for model in (start, end, half)]
        np.testing.assert_allclose(sides[2], 0.75 * sides[0] + 0.25 * sides[1])
    np.testing.assert_allclose(half.K_f, start.K_f, atol=1e-12)
    assert (blended(start, end, 0.0), blended(start, end, 1.0)) == (start, end)


def test_the_environment_belongs_to_the_certificate() -> None:
    start, end = section.disturbing()
    assert certify(start, end, np.zeros((2, 2))).by == "nothing"
    certificate = certify(start, end, np.diag([np.inf, 0.0]))  # one of the two coordinates is held
    assert certificate.stable
    rng = np.random.default_rng(2)
    M, B, K, K_f = (np.eye(3) + 0.3 * rng.random((3, 3)) for _ in range(4))
    model = TargetModel(M, 9.0 * B, 5.0 * K, K_f)
    pressing = np.array([30.0, 0.0, 7.0])
    found = certify(model, model, np.diag(pressing)).rightmost
    assert found.eigenvalue.real == pytest.approx(model.poles(np.diag(pressing)).real.max())


def planned(at: float, over: float = 0.3) -> Scenario:
    return edited(shipped()["planar3r-hybrid"], "blend", {"to": TO, "at": at, "over": over})


def run(loop: ClosedLoop, periods: int) -> ClosedLoop:
    for _ in range(periods):
        loop.step()
    return loop


def test_a_blend_in_the_loop() -> None:
    of_plan = run(ClosedLoop.from_scenario(planned(0.4)), 1000)
    rows, columns = of_plan.recording.rows(), of_plan.recording.columns
    assert [epoch.t for epoch in of_plan.recording.epochs] == pytest.approx([0.0, 0.4, 0.7])
    assert of_plan.system.scenario == edited(edited(shipped()["planar3r-hybrid"], "target_model.B_m", TO["B_m"]),
                                             "target_model.K_m", TO["K_m"])  # fmt: skip
    np.testing.assert_array_equal(np.diag(of_plan.system.controller.model.K_m), TO["K_m"])
    posted = run(ClosedLoop.from_scenario(shipped()["planar3r-hybrid"]), 400)
    posted.edit(edited(posted.system.scenario, "blend", {"to": TO, "at": posted.t, "over": 0.3}))
    np.testing.assert_array_equal(run(posted, 600).recording.rows(), rows)

    s, z = rows[:, columns["s"]], rows[:, columns["z"]]
    calm = slice(300, 400)
    for values in (s, z):  # nothing jumps, neither where the blend begins nor on its way nor where it ends
        assert np.abs(np.diff(values[395:710], axis=0)).max() < 5.0 * np.abs(np.diff(values[calm], axis=0)).max() + 1e-6
    assert np.linalg.norm(rows[400:700, columns["residual"]], axis=1).max() < 3.0  # of the model in force, N


def test_the_model_in_force_is_the_blend() -> None:
    loop = ClosedLoop.from_scenario(planned(0.0, over=0.2))
    start, blend = loop.system.controller.model, loop.system.blend
    assert blend is not None
    run(loop, 100)
    model, alpha = loop.system.controller.model, blend.share(0.099)
    assert alpha == pytest.approx(0.5, abs=0.01)
    for name in ("B_m", "K_m"):
        sides = [np.linalg.solve(m.M_m, getattr(m, name)) for m in (start, blend.end, model)]
        np.testing.assert_allclose(sides[2], (1 - alpha) * sides[0] + alpha * sides[1], atol=1e-9)
    q, F_1, A = (getattr(loop.system.controller.compensator, name) for name in ("K_vz", "F_1", "A"))
    np.testing.assert_allclose(q, np.linalg.solve(model.M_m, model.B_m) - F_1 + A, atol=1e-9)  # (13), F_2 = 1
    np.testing.assert_array_equal(loop.controlled_arm.settings.read().gains.K_vz, q)


def test_a_blend_that_begins_with_its_epoch_or_is_taken_back_is_told_by_it() -> None:
    """At t = 0, and for an edit of the same instant, there is no earlier epoch; one that is taken back never acts."""
    plan = planned(0.0).blend
    scenario = shipped()["planar3r-hybrid"]
    loop = ClosedLoop.from_scenario(scenario)
    loop.edit(msgspec.structs.replace(scenario, blend=plan))
    run(loop, 100)
    in_force = loop.system.controller.model.B_m
    recorded = loop.recording.epochs[-1].model_at(loop.t - loop.period).B_m
    np.testing.assert_allclose(recorded, in_force, rtol=1e-9)
    assert not np.allclose(in_force, ClosedLoop.from_scenario(scenario).system.controller.model.B_m, rtol=1e-3)
    later = ClosedLoop.from_scenario(planned(0.05))
    later.edit(scenario)
    run(later, 100)
    np.testing.assert_array_equal(later.recording.epochs[-1].model_at(later.t).B_m, later.system.controller.model.B_m)


def test_fork_before_a_planned_blend_is_not_labelled_as_blended() -> None:
    line = Timeline(ClosedLoop.from_scenario(shipped()["planar3r-hybrid"]))
    begun = line.loop.system.controller.model.B_m
    for _ in range(100):
        line.step()
    line.edit(planned(0.2))
    for _ in range(50):
        line.step()
    line.seek(0.05)
    line.fork()
    for _ in range(500):
        line.step()
    (epoch,) = line.recording.epochs
    np.testing.assert_array_equal(epoch.model_at(0.5).B_m, begun)


def test_a_blend_to_a_model_that_would_be_refused_is_refused() -> None:
    walls = {
        "contact.kind": "elastic",
        "second.contact.kind": "elastic",
        "second.surface.normal": [0.0, 1.0, 0.0],
        "surface.origin": [0.0, 0.0, -1.0],
        "second.surface.origin": [0.0, 1.0, 0.0],
        "motion": "hold",
    }
    scenario = with_values(shipped()["ur5-impedance"], walls)
    K_f = np.eye(6)
    K_f[0, 1] = K_f[1, 0] = 0.3
    K_m = np.diag([1000.0, 500.0, 1000.0, 1000.0, 1000.0, 1000.0])
    to = {"to": {"K_f": K_f.tolist(), "K_m": K_m.tolist()}, "at": 0.1, "over": 0.1}
    with pytest.raises(ScenarioError, match=r"blend.to: target_model: not passive with its K_f, so among several"):
        assemble(edited(scenario, "blend", to))
    begun = edited(scenario, "target_model", {"K_m": K_m.tolist(), "K_f": [1.0] * 6})
    alike = {"M_m": [10.0] * 6} | {name: (k * K_f).tolist() for name, k in (("B_m", 200), ("K_m", 1000), ("K_f", 1))}
    assemble(edited(begun, "target_model", alike))
    with pytest.raises(ScenarioError, match=r"blend.to: a model on the way: not passive with its K_f, so among sev"):
        assemble(edited(begun, "blend", {"to": alike, "at": 0.1, "over": 0.1}))
    with pytest.raises((ScenarioError, InvalidGain), match="M_m: smallest eigenvalue -1"):
        assemble(edited(scenario, "target_model.M_m", [-1.0] * 6))
    html = blend_html(Runner(begun).snapshot, Edit("target_model", alike))
    assert "blend: refused: a model on the way: not passive with its K_f" in html


def test_a_blend_is_shown_again_to_the_last_bit() -> None:
    line = Timeline(ClosedLoop.from_scenario(planned(0.2)))
    for _ in range(800):
        line.step()
    rows = line.recording.rows()
    for t in (0.1, 0.2, 0.35, 0.5, 0.6):
        line.seek(t)
        for k in range(round(1000 * t), round(1000 * t) + 30):
            np.testing.assert_array_equal(line.loop.view().q, rows[k, line.recording.columns["q"]])
            line.step()
        assert (line.loop.system.blend is None) == (t >= 0.5)
    line.seek(0.3)
    line.fork()
    for _ in range(500):
        line.step()
    np.testing.assert_array_equal(line.recording.rows(), rows)


def test_a_refusal_leaves_the_loop_as_it_was() -> None:
    start, end = disturbing_scenario()
    loop = run(ClosedLoop.from_scenario(start), 50)
    with pytest.raises(ScenarioError, match=r"blend.to: refused: at α = 0\.\d+ a pole at [\d.]+ 1/s; allowed"):
        loop.edit(blending_to(start, end, loop.t, 1.0))
    assert loop.system.scenario == start
    assert loop.system.blend is None
    with pytest.raises(ScenarioError, match=r"blend.to: target_model.K_m2: smallest eigenvalue"):
        assemble(edited(shipped()["planar3r-hybrid"], "blend.to.K_m", [0.0, -1.0, 1.0]))
    with pytest.raises(ScenarioError, match=r"blend.to: a target model of motion mode; allowed: one of impedance mode"):
        blending_to(start, shipped()["ur5-motion"], 0.0, 1.0)
    motion, hybrid = shipped()["ur5-motion"], shipped()["ur5-hybrid"]
    joints = edited(shipped()["ur5-joint"], "target_model.K_m", [50.0] * 6)
    with pytest.raises(ScenarioError, match=r"a target model in joint coordinates; allowed: one in cartesian"):
        blending_to(motion, joints, 0.0, 1.0)
    with pytest.raises(ScenarioError, match=r"blend.to: a target model with coordinates on 2 surfaces; allowed: on 1"):
        blending_to(hybrid, shipped()["ur5-corner"], 0.0, 1.0)
    under_way = run(ClosedLoop.from_scenario(planned(0.0, over=0.2)), 50)
    with pytest.raises(ScenarioError, match=r"a blend is under way; allowed: from its end on, t = 0.2 s"):
        under_way.edit(edited(under_way.system.scenario, "target_model.M_m", [9.0] * 3))
    under_way.edit(edited(under_way.system.scenario, "force.value", 22.0))  # anything else may change meanwhile
    assert run(under_way, 200).system.blend is None


def test_a_run_with_a_blend_is_reproduced_from_its_file(tmp_path: Path) -> None:
    hybrid = shipped()["planar3r-hybrid"]
    scenario = blending_to(hybrid, edited(hybrid, "target_model", TO), 0.1, 0.2)
    loop, metrics = simulate(edited(scenario, "simulation.duration", 0.5))
    write(loop, metrics, tmp_path)
    again, _ = simulate(from_toml((tmp_path / "scenario.toml").read_text()))
    np.testing.assert_array_equal(again.recording.rows(), loop.recording.rows())
    assert loop.system.blend is None


def test_a_draft_is_applied_by_a_blend_and_judged_before() -> None:
    runner = Runner(shipped()["planar3r-hybrid"])
    snapshot = runner.snapshot
    draft = model_edit(snapshot, {name: np.diag(values) for name, values in TO.items()})
    command = blending(draft, 0.2)
    assert isinstance(command, Blend)
    html = blend_html(snapshot, draft)
    assert "vs-good" in html
    assert re.search(r"certified by eigenvalues, .* at α = [\d.]+ a pole at −[\d.]+", html)
    assert blend_html(snapshot, None) == blend_html(snapshot, Edit("target_model.M_m", [0.0] * 3)) == ""
    runner.post(command)
    runner._obey(runner._queued())
    for _ in range(100):
        runner._commanded.step()
    half, revision = runner._publish(), runner.snapshot.revision
    assert half.blending == pytest.approx(0.5, abs=0.02)
    assert "blending: 4" in blend_html(half, None) or "blending: 5" in blend_html(half, None)
    assert snapshot.matrices["K_m"][1, 1] < half.matrices["K_m"][1, 1] < TO["K_m"][1]
    for _ in range(150):
        runner._commanded.step()
    done = runner._publish()
    assert done.blending is None
    assert done.revision > revision
    assert done.scenario.target_model.K_m == tuple(TO["K_m"])
    assert not done.scenario.blend.planned


def test_an_unstable_blend_is_refused_on_the_page() -> None:
    start, end = disturbing_scenario()
    snapshot = Runner(start).snapshot
    matrices = {name: np.array(getattr(end.target_model, name)) for name in ("M_m", "B_m", "K_m")}
    draft = model_edit(snapshot, matrices)
    assert re.search(r"vs-bad.*blend: refused: at α = 0\.\d+ a pole at \d", blend_html(snapshot, draft))


@pytest.mark.slow
def test_the_section_shows_no_violation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(section, "END", section.BEGIN + section.OVER + 0.2)
    jobs = section.SECTION.jobs(40)
    findings = section.SECTION.conclude([job.function(*job.arguments) for job in jobs])
    assert findings.numbers["wrong"] == "0"
    assert section.SECTION.text(findings, "pictures").startswith("## ")


@pytest.mark.parametrize("by", ["rows", "columns"])
def test_theorem_4_says_nothing_of_negative_couplings(by: By) -> None:
    A = np.array([[-1.0, -0.5], [0.1, -1.0]])
    assert hurwitz_on_hull([np.abs(A) - 2.0 * np.eye(2)] * 2, by)
    assert not hurwitz_on_hull([A, A], by)


@pytest.mark.parametrize("by", ["rows", "columns"])
def test_theorem_3_says_nothing_of_what_is_unstable_or_negative(by: By) -> None:
    A = np.array([[0.5, 0.9], [0.9, 0.5]])  # its eigenvalues are 1.4 and -0.4
    assert not schur_on_hull([A, A], by)
    assert schur_on_hull([0.5 * A, 0.5 * A], by)
    assert not schur_on_hull([-0.5 * A, -0.5 * A], by)
