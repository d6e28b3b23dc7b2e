"""The target model as people edit it: omega and zeta, whole matrices as text, poles and what is said of them."""

import asyncio
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import viser
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from app.dashboard.panels.model import matrix_note, oscillator_note
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.fields.edit_lock import EditLock
from app.dashboard.widgets.fields.matrix_editor import Draft, MatrixEditor, starts, with_entries
from app.dashboard.widgets.fields.matrix_text import read_back, read_matrix, require_point, written, written_rows
from app.dashboard.widgets.fields.model_fields import (
    DiagonalBinding,
    OscillatorBinding,
    model_edit,
    only,
    oscillators_of,
)
from app.dashboard.widgets.run.whatif import changed
from app.dashboard.widgets.target_model.equation import EquationLine, equation_html, lines
from app.dashboard.widgets.target_model.model_checks import checks_html, judge_requested, judge_running
from app.dashboard.widgets.target_model.pole_map import grouped, pole_map_html
from app.dashboard.widgets.theorem.theorem_table import facts_html
from app.scenario.data import edited, shipped
from app.scenario.errors import ScenarioError
from app.session.commands import Blend, Edit, EditAll, EditModel
from app.session.runner import Runner
from app.session.snapshot import Snapshot
from controllers.modes import MODES
from controllers.second_order import oscillators, shaped
from controllers.target_model import InvalidGain, TargetModel
from tests.support.desks import Posted

positive = st.floats(1e-2, 1e3)
SIX = np.arange(1.0, 7.0)


def snapshot_of(name: str, path: str = "", value: object = None) -> Snapshot:
    scenario = shipped()[name]
    return Runner(edited(scenario, path, value) if path else scenario).snapshot


@pytest.fixture(scope="module")
def hybrid() -> Snapshot:
    return snapshot_of("ur5-hybrid")


def applied(snapshot: Snapshot, edit: Edit | EditModel) -> Snapshot:
    """The snapshot of a model that this edit has changed."""
    judged = judge_requested(snapshot, edit)
    assert judged.refusal == ""
    system = replace(snapshot.system, controller=snapshot.system.controller.following(judged.model))
    return replace(snapshot, scenario=changed(snapshot.scenario, edit), system=system)


def test_omega_zeta_and_a_matrix_of_one_picture_of_the_page_all_hold():
    """Each is converted for the model that then runs; of one axis the last position counts."""
    runner = Runner(shipped()["ur5-hybrid"])
    seen = runner.snapshot
    swing = {(kind, i): OscillatorBinding("target_model", kind, i) for kind in ("omega", "zeta") for i in (0, 1, 2)}
    K_m = np.diag(seen.matrices["K_m"]).copy()
    K_m[4] = 4500.0
    for batch in (
        [
            swing["omega", 1].edit(seen, 30.0),
            swing["zeta", 1].edit(seen, 0.4),
            swing["zeta", 1].edit(seen, 0.5),
            DiagonalBinding("target_model.M_m", 2).edit(seen, 4.0),
        ],
        [swing["zeta", 2].edit(seen, 0.7), swing["omega", 0].edit(seen, 25.0)],
        [swing["zeta", 0].edit(seen, 0.8), DiagonalBinding("target_model.M_m", 3).edit(seen, 7.0)],
    ):
        runner._obey(batch)
    after = runner._publish()
    assert (after.refusal, after.revision - seen.revision) == (None, 7)
    before, now = oscillators_of(seen), oscillators_of(after)
    assert now.omega[:3] == pytest.approx([25.0, 30.0, np.sqrt(4000.0 / 4.0)])
    assert now.zeta[:3] == pytest.approx([0.8, 0.5, 0.7])
    np.testing.assert_array_equal(now.zeta[4:], before.zeta[4:])
    assert after.matrices["K_m"][0, 0] == 0.0
    runner._obey([only({"K_m": np.diag(K_m)})])  # a draft of the first picture, too
    assert runner._publish().matrices["K_m"][4, 4] == 4500.0
    assert oscillators_of(runner._publish()).zeta[0] == pytest.approx(0.8)
    # nothing swings into a rigid surface: refused, where the page has not seen it yet
    runner._obey([Edit("mode", "constrained"), swing["zeta", 0].edit(seen, 0.3)])
    assert "coordinate 1 does not swing" in runner._publish().refusal


def test_a_draft_that_is_applied_sets_its_matrices_only(hybrid: Snapshot, viser_server: viser.ViserServer):
    posted = Posted()

    desk = SimpleNamespace(gui=viser_server.gui, post=posted.post, snapshot=lambda: hybrid)
    editor = MatrixEditor(cast(Desk, desk))
    editor._draft = Draft(6, {"K_m": "0 4000 4000 4000 4000 4500"})
    apply = cast(viser.GuiEvent, SimpleNamespace(target=SimpleNamespace(value="apply all")))
    asyncio.run(editor._on_button(apply))
    editor._seconds = 2.0
    asyncio.run(editor._on_button(apply))
    K_m = [0.0, 4000.0, 4000.0, 4000.0, 4000.0, 4500.0]
    assert posted[0] == EditAll({"target_model.K_m": K_m})
    assert isinstance(posted[1], Blend)
    assert posted[1].model["K_m"] == K_m


def test_a_lesson_that_allows_damping_allows_zeta_and_not_omega(hybrid: Snapshot):
    posted, complaints = Posted(), list[str]()
    lock = EditLock(posted.post, complaints.append)
    lock.fields = frozenset({"target_model.B_m"})
    zeta, omega = (OscillatorBinding("target_model", kind, 1).edit(hybrid, 2.0) for kind in ("zeta", "omega"))
    assert lock.post(zeta)
    assert not lock.post(omega)
    assert posted == [zeta]
    locked = complaints[0].partition(": locked")[0]
    assert ("B_m" in locked, "K_m" in locked, "K_f" in locked) == (False, True, True)


@settings(deadline=None)
@given(positive, positive, positive, st.floats(0.0, 1.0), st.just(0.0) | st.floats(1.0, 1e5))
def test_shaped_entries_give_what_was_asked_for(M_m: float, omega: float, zeta: float, K_m: float, K_e: float):
    entries = shaped(M_m, K_m, 1.0, K_e, omega, zeta)
    if K_e:
        assert entries.K_m == K_m
    else:
        assert entries.K_f == 1.0
    s = np.roots([M_m, entries.B_m, entries.K_m + entries.K_f * K_e])
    np.testing.assert_allclose(np.prod(s).real, omega**2, rtol=1e-6)
    np.testing.assert_allclose(s.sum().real, -2.0 * zeta * omega, rtol=1e-6)
    axis = np.eye(1)
    found = oscillators(M_m * axis, entries.B_m * axis, entries.K_m * axis, entries.K_f * axis, np.array([K_e]))
    np.testing.assert_allclose([found.omega[0], found.zeta[0]], [omega, zeta], rtol=1e-6)


def test_omega_and_zeta_of_known_axes():
    found = oscillators(
        np.diag([10.0, 2.0, 15.0]), np.diag([632.0, 4.0, 100.0]), np.diag([0.0, 50.0, 0.0]), np.diag([1.0, 0.0, 1.0]),
        np.array([1e4, 0.0, np.inf]),
    )  # fmt: skip
    np.testing.assert_allclose(found.omega, [np.sqrt(1000.0), 5.0, np.nan])
    np.testing.assert_allclose(found.zeta, [632.0 / (20.0 * np.sqrt(1000.0)), 0.2, np.nan])


@pytest.mark.parametrize(("kind", "other", "index"), [("omega", "zeta", 1), ("zeta", "omega", 1), ("omega", "zeta", 0)])
def test_editing_one_keeps_the_other_and_all_else(hybrid: Snapshot, kind: str, other: str, index: int):
    before = oscillators_of(hybrid)
    after = applied(hybrid, OscillatorBinding("target_model", kind, index).edit(hybrid, 7.5))
    now = oscillators_of(after)
    assert getattr(now, kind)[index] == pytest.approx(7.5)
    np.testing.assert_allclose(getattr(now, other), getattr(before, other))
    np.testing.assert_array_equal(after.matrices["M_m"], hybrid.matrices["M_m"])
    assert after.matrices["K_m"][0, 0] == 0.0  # so that the force error vanishes, (37)
    rest = np.arange(6) != index
    np.testing.assert_allclose(getattr(now, kind)[rest], getattr(before, kind)[rest])
    place = OscillatorBinding("target_model", kind, index)
    assert place.read(after) == pytest.approx(7.5)


def test_editing_an_axis_keeps_coupling(hybrid: Snapshot):
    coupled = hybrid.matrices["K_m"].copy()
    coupled[1, 2] = coupled[2, 1] = 500.0
    after = applied(hybrid, model_edit(hybrid, {"K_m": coupled}))
    for place, value in (
        (OscillatorBinding("target_model", "omega", 1), 30.0),
        (DiagonalBinding("target_model.K_m", 1), 9000.0),
    ):
        edited_once = applied(after, place.edit(after, value)).matrices["K_m"]
        assert (edited_once[1, 1], edited_once[1, 2]) == (9000.0, 500.0)


def test_linked_axes_are_those_that_are_alike(hybrid: Snapshot):
    """psi_1, psi_2 and the three angles of ur5-hybrid have the same stiffness, phi another one."""
    stiffness = np.diag([0.0, 9000.0, 9000.0, 4000.0, 4000.0, 4000.0])
    linked = DiagonalBinding("target_model.K_m", 1, lambda: True)
    np.testing.assert_array_equal(applied(hybrid, linked.edit(hybrid, 9000.0)).matrices["K_m"], stiffness)
    apart = applied(hybrid, DiagonalBinding("target_model.K_m", 2).edit(hybrid, 5000.0))
    stiffness[2, 2] = 5000.0
    np.testing.assert_array_equal(applied(apart, linked.edit(apart, 9000.0)).matrices["K_m"], stiffness)
    swinging = OscillatorBinding("target_model", "omega", 4, lambda: True)
    before, after = oscillators_of(hybrid), oscillators_of(applied(hybrid, swinging.edit(hybrid, 7.5)))
    np.testing.assert_allclose(after.omega, [*before.omega[:3], 7.5, 7.5, 7.5])
    np.testing.assert_allclose(after.zeta, before.zeta)


def test_edits_of_one_picture_of_the_page_all_hold():
    """A second edit is made before the page has seen the first one: also in one batch of commands, where only the last
    position of a slider counts."""
    runner = Runner(shipped()["ur5-hybrid"])
    seen = runner.snapshot
    K_m = [DiagonalBinding("target_model.K_m", i) for i in (1, 2, 3)]
    zeta = OscillatorBinding("target_model", "zeta", 4)
    runner._obey(
        [
            K_m[0].edit(seen, 4100.0),
            K_m[0].edit(seen, 4200.0),
            K_m[1].edit(seen, 4300.0),
            zeta.edit(seen, 0.5),
            zeta.edit(seen, zeta.read(seen)),
            K_m[2].edit(seen, 4400.0),
        ]
    )
    after = runner._publish()
    assert after.revision - seen.revision == 4
    expected = seen.matrices["K_m"].copy()
    expected[1, 1], expected[2, 2], expected[3, 3] = 4200.0, 4300.0, 4400.0
    np.testing.assert_array_equal(after.matrices["K_m"], expected)
    np.testing.assert_allclose(after.matrices["B_m"], seen.matrices["B_m"])
    assert after.scenario.target_model.M_m == seen.scenario.target_model.M_m  # the mode's default is not written out


@pytest.mark.parametrize("value", [0.0, -3, [1, 2]])
def test_what_is_no_frequency_is_refused_in_a_sentence(hybrid: Snapshot, value: object):
    with pytest.raises(ValueError, match=re.escape(written(value))):
        OscillatorBinding("target_model", "omega", 1).edit(hybrid, value)


def test_a_coordinate_held_by_a_rigid_surface_has_neither():
    snapshot = snapshot_of("ur5-constrained")
    assert OscillatorBinding("target_model", "omega", 0).read(snapshot) is None
    assert OscillatorBinding("target_model", "omega", 1).read(snapshot) == pytest.approx(20.0)
    assert OscillatorBinding("target_model", "omega", 6).read(snapshot) is None
    assert "held by the rigid surface" in oscillator_note(snapshot, "rad/s")
    assert len(judge_running(snapshot).poles) == 10
    assert "sampled" in facts_html(snapshot)


@settings(deadline=None)
@given(arrays(float, (3, 3), elements=st.floats(-1e12, 1e12)), st.sampled_from([" ", ", ", "\t", " ,"]),
       st.sampled_from(["\n", ";", " ;\r\n", "\n\n"]))  # fmt: skip
def test_a_matrix_is_read_as_it_is_pasted(matrix: np.ndarray, between: str, end: str):
    pasted = end.join(between.join(repr(float(x)) for x in row) for row in matrix)
    np.testing.assert_array_equal(read_matrix(pasted, 3), matrix)
    np.testing.assert_array_equal(read_matrix(written_rows(matrix), 3), matrix)
    np.testing.assert_array_equal(read_matrix(str(matrix.tolist()), 3), matrix)
    np.testing.assert_array_equal(read_matrix(between.join(map(repr, map(float, matrix[0]))), 3), np.diag(matrix[0]))
    np.testing.assert_array_equal(read_matrix(end.join(map(repr, map(float, matrix[0]))), 3), np.diag(matrix[0]))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "nothing; allowed: 3 numbers"),
        ("1 2", "1 row(s) of 2"),
        ("1 2 3\n4 5\n6 7 8", "3 row(s) of 2 or 3"),
        ("1 2 3; 4 5 6", "2 row(s) of 3"),
        ("1 x 3", "'x' is not a number"),
        ("1 nan 3", "'nan' is not a finite number"),
        ("1 2 1e999", "not a finite"),
        ("__import__('os') 2 3", "__import__"),
    ],
)
def test_text_that_is_no_matrix_is_refused_with_the_reason(text: str, reason: str):
    with pytest.raises(ValueError, match=re.escape(reason)):
        read_matrix(text, 3)


@settings(deadline=None)
@given(st.text(alphabet="0123456789+-.eE,;[]() \n\tnaif_x", max_size=60), st.integers(1, 4))
def test_any_text_gives_a_matrix_or_a_sentence(text: str, n: int):
    try:
        matrix = read_matrix(text, n)
    except ValueError:
        return
    assert matrix.shape == (n, n)
    assert np.isfinite(matrix).all()


def test_a_field_shows_and_reads_lists_and_matrices():
    for value in (5, [1.5, 2.0, -3.0], [[100.0, 1.0], [1.0, 50.0]]):
        assert read_back(written(value)) == value
    assert read_back("10, 10; 5, 1") == [[10, 10], [5, 1]]
    assert read_back("1; 2; 3") == [1, 2, 3]
    with pytest.raises(ValueError, match="'' is not a number"):
        read_back("1, , 2")


@pytest.mark.parametrize(("text", "point", "two"), [("2,5", "2.5", "2, 5"), ("-1,000", "-1.000", "-1, 000")])
def test_a_decimal_comma_in_a_field_of_one_number_is_refused_with_both_of_its_meanings(text: str, point: str, two: str):
    with pytest.raises(ValueError, match=f"^'{text}' has a comma.*; allowed: {point} for one number, '{two}' for two$"):
        require_point(text)
    for fine in ("2.5", "2, 5", "1, 2, 3", "3e4"):
        require_point(fine)


def test_a_draft_is_judged_as_a_whole(hybrid: Snapshot):
    draft = Draft(6).with_text("K_m", "0 1 2 3 4 5").with_text("M_m", "1 1 1 1 1")
    with pytest.raises(ValueError, match=r"^M_m: 1 row\(s\) of 5"):
        draft.matrices()
    whole = draft.with_text("M_m", "2 2 2 2 2 2").matrices()
    after = applied(hybrid, model_edit(hybrid, whole))
    np.testing.assert_array_equal(np.diag(after.matrices["K_m"]), SIX - 1.0)
    np.testing.assert_array_equal(after.matrices["M_m"], 2.0 * np.eye(6))
    assert after.scenario.target_model.B_m is None


def test_a_block_sets_what_was_changed_and_its_mirror_image():
    matrix = np.diag(SIX)
    changed = with_entries(matrix, 0, 3, np.array([[0.0, 7.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    assert changed[0, 4] == changed[4, 0] == 7.0
    assert np.count_nonzero(changed - matrix) == 2
    assert [starts(n) for n in (2, 3, 4, 6, 7)] == [[0], [0], [0, 1], [0, 3], [0, 3, 4]]


def test_poles_are_the_eigenvalues_of_the_companion_matrix():
    rng = np.random.default_rng(4)
    M, B, K = (X @ X.T + 0.1 * np.eye(3) for X in rng.normal(size=(3, 3, 3)))
    model = TargetModel(M, B, K, np.diag([2.0, 0.0, 0.0]))

    def eigenvalues(M: np.ndarray, B: np.ndarray, K: np.ndarray) -> np.ndarray:
        low = -np.linalg.solve(M, np.hstack([K, B]))
        return np.sort_complex(np.linalg.eigvals(np.vstack([np.eye(len(M), 2 * len(M), len(M)), low])))

    pressing, held = (np.sort_complex(MODES[name].poles(model, 40.0)) for name in ("hybrid", "constrained"))
    np.testing.assert_allclose(pressing, eigenvalues(M, B, K + np.diag([80.0, 0.0, 0.0])), atol=1e-9)
    np.testing.assert_allclose(held, eigenvalues(M[1:, 1:], B[1:, 1:], K[1:, 1:]), atol=1e-9)


def test_the_pole_map_shows_omega_zeta_and_how_often():
    poles = grouped(np.array([-3 + 4j, -3 - 4j, -20.0 + 1e-6j, -20.0 - 1e-6j, -20.0, 2.0]))
    assert [(p.omega, p.zeta, p.count) for p in poles] == [
        (2.0, -1.0, 1),
        (5.0, pytest.approx(0.6), 2),
        (pytest.approx(20.0), pytest.approx(1.0), 3),
    ]
    picture = pole_map_html(poles, [])
    assert "−3 ± 4 j 1/s, ω = 5 rad/s, ζ = 0.6" in picture
    assert picture.count("<title>") == 3
    x = [float(x) + 4.5 for x in re.findall(r'<path d="M ([\d.]+) ', picture)]
    assert x[0] > 168.0 > x[1] > x[2]  # unstable poles lie right of the origin, fast ones farther out
    assert pole_map_html(grouped(np.array([0.0, -1e-30, -1e-300])), [])


def test_eigenvalues_have_the_units_of_the_coordinates(hybrid: Snapshot):
    assert "B_m [N·s/m]" in checks_html(hybrid, None)
    shown = checks_html(snapshot_of("ur5-joint"), None)
    assert all(f"[{unit}]" in shown for unit in ("kg·m²", "N·m·s/rad", "N·m/rad"))


def test_what_is_asked_for_is_judged_beside_what_runs(hybrid: Snapshot):
    assert judge_running(hybrid).slowest == pytest.approx(-20.0, rel=1e-3)
    indefinite = hybrid.matrices["K_m"].copy()
    indefinite[1, 2] = indefinite[2, 1] = 5000.0
    asked = judge_requested(hybrid, model_edit(hybrid, {"K_m": indefinite}))
    assert asked.refusal == "target_model.K_m2: smallest eigenvalue -1000; allowed: symmetric positive definite"
    assert asked.slowest > 0.0
    shown = checks_html(hybrid, model_edit(hybrid, {"K_m": indefinite}))
    assert "asked: not stable" in shown
    assert "−1000 … 9000" in shown
    for value in ([1.0, 2.0], [0.0] * 6):
        with pytest.raises((ScenarioError, InvalidGain)):
            judge_requested(hybrid, Edit("target_model.M_m", value))
        assert 'vs-bad">M_m: ' in checks_html(hybrid, Edit("target_model.M_m", value))


def test_an_entry_that_the_mode_fixes_is_named(hybrid: Snapshot):
    coupled = hybrid.matrices["K_m"].copy()
    coupled[0, 2] = 3.0
    refusal = judge_requested(hybrid, model_edit(hybrid, {"K_m": coupled})).refusal
    assert "K_m: an entry that hybrid mode fixes at 0 (34) is 3, in row 1, column 3" in refusal


def test_equal_coordinates_share_a_line_and_coupled_ones_a_block(hybrid: Snapshot):
    assert lines(hybrid) == [EquationLine((0,), False), EquationLine((1, 2, 3, 4, 5), False)]
    coupled = hybrid.matrices["K_m"].copy()
    coupled[1, 4] = coupled[4, 1] = 123.0
    after = applied(hybrid, model_edit(hybrid, {"K_m": coupled}))
    assert lines(after) == [EquationLine((0,), False), EquationLine((1, 4), True), EquationLine((2, 3, 5), False)]
    shown = equation_html(after)
    assert shown.count("<mn>123</mn>") == 2
    assert re.findall(r'vs-where">([^<]+)', shown) == ["(8)", "φ", "ψ₁", "ℓ·β", "ψ₂ ℓ·α ℓ·γ"]
    assert "(34)" in shown
    assert "The normal force follows" in shown
    assert "does not guarantee this" not in shown
    other = snapshot_of("ur5-hybrid", "controller.law", "computed-torque")
    assert "The present law, computed torque, does not guarantee this." in equation_html(other)
    full = np.diag([0.0, 4e4, 4e4, 4e4, 4e4, 4e4])
    full[1:, 1:] += 7.0
    below = equation_html(applied(hybrid, model_edit(hybrid, {"K_m": full})))
    assert below.count("<math") == 2
    assert below.count("<mn>40007</mn>") == 5


def test_angles_are_told_per_radian(hybrid: Snapshot):
    note = matrix_note(hybrid, "K_m", "stiffness")
    assert "α, β, γ: 90 N·m/rad" in note  # 4000 N/m times (0.15 m)²
    joint = snapshot_of("ur5-motion", "task_space.kind", "joint")
    assert matrix_note(joint, "K_m", "stiffness") == "stiffness, N·m/rad"
