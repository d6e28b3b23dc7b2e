"""Surfaces and trajectories of a user's own: files named by `--use`."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from app.scenario.data import differences, edited, from_toml, load, to_toml
from app.scenario.errors import ScenarioError
from app.scenario.own_code import OwnCodeError, own_code, own_course, own_shape, use
from app.scenario.schema import Scenario
from app.session.changes import in_mode, on_surface
from app.session.headless_run import simulate
from app.session.ways_out import nearest
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from environments.surfaces.own import OwnForm
from environments.surfaces.table import Surface
from environments.trajectories.own import OwnPath
from environments.trajectories.table import evaluated, numbered
from tests.support.same_rows import require_same_rows

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
PLANE = """
from environments.surfaces.own import OwnSurface
from kernels import inline
from parameters import Parameter

@inline
def chart(zeta, p, g, G, G_p):
    g[0], g[1], g[2] = -zeta[2] - p.depth, zeta[0], -zeta[1]
    G[0, 2], G[1, 0], G[2, 1] = -1.0, 1.0, {slope}

SURFACE = OwnSurface("floor", "Floor", "level", chart, (Parameter("depth", 0.0, -1.0, 1.0, "m", "below"),))
"""
PLAIN = PLANE.replace(" - p.depth", "").partition("SURFACE")[0] + 'SURFACE = OwnSurface("plain", "Plain", "", chart)'
CIRCLE = """
import numpy as np
from environments.trajectories.own import OwnTrajectory
from kernels import inline
from parameters import Parameter

@inline
def path(t, p, value, rate, acceleration):
    w = 2 * np.pi / p.period
    c, s = np.cos(w * t), np.sin(w * t)
    value[0], value[1] = p.radius * (c - 1.0), p.radius * s
    rate[0], rate[1] = -p.radius * w * s, p.radius * w * c
    acceleration[0], acceleration[1] = -p.radius * w * w * c, -p.radius * w * w * s

TRAJECTORY = OwnTrajectory("ring", "Ring", "round", path, (
    Parameter("radius", 0.05, 0.0, 1.0, "m", "radius"), Parameter("period", 4.0, 1.0, 9.0, "s", "of a turn"),
))
"""

PUT = """
from kernels import inline

@inline
def put(array, place, number):
    array[place] = number
"""


@pytest.fixture
def written(tmp_path: Path) -> Callable[[str], Path]:
    def write(text: str, name: str = "mine") -> Path:
        path = tmp_path / f"{name}.py"
        path.write_text(text)
        return path

    return write


@pytest.fixture
def beside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file beside that of the user's own, whose functions have no checks of their indices."""
    (tmp_path / "beside.py").write_text(PUT)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "beside", raising=False)


def rows(scenario: Scenario, periods: int = 150) -> np.ndarray:
    loop = ClosedLoop.from_scenario(scenario)
    for _ in range(periods):
        loop.step()
    return loop.recording.rows()


def test_a_surface_and_a_path_of_one_s_own_give_the_run_of_the_same_ones_of_ours(
    written: Callable[[str, str], Path],
) -> None:
    use([written(PLANE.format(slope=-1.0), "floor"), written(CIRCLE, "ring")])
    ours = edited(load("ur5-hybrid"), "motion", {"kind": "circle", "radius": 0.05, "period": 4.0, "ramp": 0.0})
    depth = -ours.surface.origin[2]
    floor = {"kind": "own", "name": "floor", "parameters": {"depth": depth}, "motion": {"amplitude": 0.003}}
    ours = edited(ours, "surface.motion.amplitude", 0.003)
    mine = edited(edited(ours, "surface", floor), "motion", "own:ring")
    assert from_toml(to_toml(mine)) == mine
    one, other = rows(mine), rows(ours)
    psi = Surface.of(ours.surface).frame[1:]
    np.testing.assert_allclose(psi, [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], atol=1e-15)  # the same tangents
    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def test_derivatives_of_the_examples() -> None:
    use([EXAMPLES / "cone.py", EXAMPLES / "figure_eight.py"])
    form, near = OwnForm(name="cone", origin=(0.5, 0.0, 0.3)), np.array([0.47, 0.07, 0.33])
    cone, h = Surface.of(form, near, own_shape(form)), 1e-6
    cone.require_regular(1.0)
    chart = cone.chart(near, 0.0)
    assert np.linalg.norm(chart.G[0]) == pytest.approx(1.0)
    np.testing.assert_allclose(chart.G @ chart.G.T, np.diag(np.diag(chart.G @ chart.G.T)), atol=1e-12)
    np.testing.assert_allclose(cone.point(chart.g, 0.0), near, atol=1e-12)
    tip = np.array([0.5 - 0.3 * np.sin(1.2), 0.0, 0.3 + 0.3 * np.cos(1.2)])
    axis = cone.chart(tip - [1e-9, 0.0, 0.2], 0.0).g
    assert axis[:2] == pytest.approx([0.2 * np.sin(1.2), 0.2 * np.cos(1.2) - 0.3])  # 0.2 m straight below the tip
    np.testing.assert_allclose(cone.chart(np.array(form.origin), 0.0).g, 0.0, atol=1e-15)
    vertices, faces = cone.mesh(near, 0.0)
    np.testing.assert_allclose([cone.chart(v, 0.0).g[0] for v in vertices[np.unique(faces)]], 0.0, atol=1e-9)
    assert len(faces) > 1000
    path = OwnPath(name="figure-eight")
    course = numbered(path, own_course(path, 5, range(1, 3)))
    assert not evaluated(course, 0.0).value.any()
    for t in (0.3, 1.7, 4.4):
        before, here, after = (evaluated(course, t + dt) for dt in (-h, 0.0, h))
        assert here.value[1:3].all()
        assert not here.value[[0, 3, 4]].any()
        np.testing.assert_allclose((after.value - before.value) / (2 * h), here.rate, atol=1e-8)
        np.testing.assert_allclose((after.rate - before.rate) / (2 * h), here.acceleration, atol=1e-7)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (
            "-p.radius * w * w * c,",
            "-0.9 * p.radius * w * w * c,",
            "its acceleration is not what differences say, by 0.0",
        ),
        ("= -p.radius * w * s,", "= -0.9 * p.radius * w * s,", "its rate is not what differences say, by 0.00"),
        ("p.radius * s\n", "p.radius * s + 0.05\n", "the path is 0.05 away from the start; allowed: 0"),
        ("p.radius * s\n", "p.radius * s + np.sqrt(1.0 - t) - 1.0\n", "the path is not finite; allowed: one that is"),
    ],
)
def test_a_path_with_wrong_derivatives_or_without_an_end_is_refused(
    written: Callable[[str], Path], old: str, new: str, sentence: str
) -> None:
    assert old in CIRCLE
    use([written(CIRCLE.replace(old, new))])
    with pytest.raises(ScenarioError, match=rf"^motion\.name: at t = \S+ s {sentence}"):
        ClosedLoop.from_scenario(edited(load("ur5-hybrid"), "motion", "own:ring"))


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("if t > 1.0: raise ValueError('late')", r"ValueError: late, tried at t = 1\.7 s with value\.shape\[0\] = 2"),
        ("if t > 1.0: raise ZeroDivisionError", "ZeroDivisionError, tried at t = 1"),
        ("value[:] = np.zeros(5)", "ValueError: cannot assign slice"),
        ("value[2 + int(t)] = 0.0", "IndexError: index is out of bounds, tried at t = 0 s"),
    ],
)
def test_a_path_that_fails_where_it_is_tried_is_refused_with_its_line(
    written: Callable[[str], Path], line: str, said: str, capfd: pytest.CaptureFixture[str]
) -> None:
    use([written(CIRCLE.replace("inline", "allocating").replace("    w = ", f"    {line}\n    w = "))])
    with pytest.raises(OwnCodeError, match=rf"^\S*mine\.py, line 9: {said}"):
        ClosedLoop.from_scenario(edited(load("ur5-hybrid"), "motion", "own:ring"))
    assert capfd.readouterr().err == ""


def test_a_path_that_fails_later_stops_the_run_by_both_engines_with_its_line(
    written: Callable[[str], Path], capfd: pytest.CaptureFixture[str]
) -> None:
    """After the duration, up to which the path is looked at before the run."""
    late = "    if 0.25 < t and t < 1.0:\n        raise ValueError('late')\n    w = "
    use([written(CIRCLE.replace("    w = ", late))])
    scenario = edited(edited(load("ur5-hybrid"), "motion", "own:ring"), "simulation.duration", 0.2)
    stepped, compiled = ClosedLoop.from_scenario(scenario), ClosedLoop.from_scenario(scenario)
    for _ in range(300):
        stepped.advance()
    CompiledRun(compiled).advance(300)
    assert stepped.stopped is not None
    assert re.fullmatch(
        r"t = 0\.251 s: a function of --use failed \(\S*mine\.py, line 10: ValueError: late\)", stepped.stopped
    )
    assert len(stepped.recording) == 251
    require_same_rows(stepped, compiled)
    assert np.isfinite(stepped.view().q).all()
    assert capfd.readouterr().err == ""


def test_a_surface_that_fails_is_refused_with_its_line_and_not_drawn_there(written: Callable[[str], Path]) -> None:
    text = PLANE.format(slope=-1.0)
    chart = text[text.index("    g[0]") :].splitlines()[0]
    # of different lengths: Python takes two files of one length, written in the same second, for the same
    for limit, said in (("0.001", r", tried at zeta = \(0\.01, 0, 0\) m"), ("0.0110", "$")):
        use([written(text.replace(chart, f"    if zeta[0] > {limit}:\n        raise ValueError('far')\n{chart}"))])
        with pytest.raises(OwnCodeError, match=rf"mine\.py, line 9: ValueError: far{said}"):
            ClosedLoop.from_scenario(on_surface(load("ur5-hybrid"), "own:floor"))
    form = OwnForm(name="floor")
    floor = Surface.of(form, shape=own_shape(form))
    with pytest.raises(ValueError, match="far"):
        floor.chart(np.array([0.02, 0.0, 0.0]), 0.0)
    vertices, faces = floor.mesh(np.zeros(3), 0.0)
    assert 0.0 <= vertices[faces][..., 0].max() <= 0.011


@pytest.mark.usefixtures("beside")
@pytest.mark.parametrize("number", ["0.01", "0.0"])
def test_a_path_that_writes_beyond_its_coordinates_elsewhere_is_refused(
    written: Callable[[str], Path], number: str
) -> None:
    text = CIRCLE.replace("    rate[0],", f"    put(acceleration, 4, {number})\n    rate[0],")
    use([written("from beside import put\n" + text)])
    with pytest.raises(ScenarioError, match=r"'ring' writes coordinate 5; allowed: 1 to 2 \(value"):
        ClosedLoop.from_scenario(edited(load("ur5-hybrid"), "motion", "own:ring"))
    with pytest.raises(ScenarioError, match=r"line 12: IndexError: index is out of bounds, tried at .* with \S* = 1$"):
        ClosedLoop.from_scenario(edited(load("planar3r-hybrid"), "motion", "own:ring"))
    use([EXAMPLES / "figure_eight.py"])
    loop = ClosedLoop.from_scenario(edited(load("planar3r-hybrid"), "motion", "own:figure-eight"))
    reference = loop.system.reference(2.3)
    assert reference.r_d[1] != loop.system.reference(0.0).r_d[1]
    assert reference.r_d[2] == loop.system.reference(0.0).r_d[2]  # the angle is not moved


@pytest.mark.usefixtures("beside")
@pytest.mark.parametrize(("entry", "array"), [("g, 3", "g"), ("G, (3, 1)", "G"), ("G_p, (2, 2, 3)", "G_p")])
def test_a_surface_that_writes_beyond_its_coordinates_elsewhere_is_refused(
    written: Callable[[str], Path], entry: str, array: str
) -> None:
    chart = PLAIN.format(slope=-1.0).rstrip()
    body = chart[chart.index("def chart") :].splitlines()[1]
    use([written("from beside import put\n" + chart.replace(body, f"    put({entry}, 0.0)\n{body}"))])
    with pytest.raises(ScenarioError, match=rf"'plain' writes behind the end of {array}; allowed: indices 0 to 2"):
        ClosedLoop.from_scenario(on_surface(load("ur5-hybrid"), "own:plain"))


def test_a_surface_whose_phi_is_no_penetration_in_metres_is_refused(written: Callable[[str], Path]) -> None:
    use(
        [
            written(
                PLAIN.format(slope=-1.0).replace("= -zeta[2]", "= -3.0 * zeta[2]").replace("= -1.0, 1.0", "= -3.0, 1.0")
            )
        ]
    )
    with pytest.raises(ScenarioError, match=r"'plain' has a gradient of phi of the length 3 at .*; allowed: 1 on the"):
        ClosedLoop.from_scenario(on_surface(load("ur5-hybrid"), "own:plain"))


def test_one_without_parameters(written: Callable[[str], Path]) -> None:
    use([written(PLAIN.format(slope=-1.0))])
    form = OwnForm(name="plain", origin=(0.0, 0.0, 0.2))
    plain = Surface.of(form, shape=own_shape(form))
    assert plain.chart(np.array([0.1, 0.2, 0.15]), 0.0).g == pytest.approx([0.05, 0.1, -0.2])


@pytest.mark.slow
def test_the_examples_are_pressed_and_followed() -> None:
    use([EXAMPLES / "cone.py", EXAMPLES / "figure_eight.py"])
    scenario = edited(edited(load("ur5-hybrid"), "motion", "own:figure-eight"), "simulation.duration", 4.0)
    scenario = edited(scenario, "motion.parameters.width", 0.03)
    scenario = on_surface(scenario, "own:cone")
    loop = ClosedLoop.from_scenario(scenario)
    assert abs(loop.system.surface.chart(loop.view().tool, 0.0).g[0]) <= 0.03
    again = in_mode(in_mode(scenario, "motion"), "hybrid")
    assert again.surface == scenario.surface
    loop, metrics = simulate(edited(again, "surface.parameters.angle", 1.4))
    assert loop.stopped is None
    assert metrics.force_error_tail < 0.1
    assert metrics.motion_error_tail < 1e-3


def test_where_there_is_none_of_its_name_the_scenario_is_kept_and_the_field_is_named(
    written: Callable[[str, str], Path],
) -> None:
    loop = ClosedLoop.from_scenario(load("ur5-hybrid"))
    now = loop.system.scenario
    for change, said in (
        (("motion", "own:ring"), "motion.name: 'ring'; allowed: none, since no file that --use names has one"),
        (("surface", "own:x"), "surface.name: 'x'; allowed: none, since no file that --use names has one"),
    ):
        with pytest.raises(ScenarioError) as refused:
            loop.edit(edited(now, *change))
        assert str(refused.value) == said
    use([written(CIRCLE, "ring")])
    ring = edited(now, "motion", "own:ring")
    for name, value, said in (
        ("radius", -1.0, "motion.parameters.radius: -1 m; allowed: 0 to 1 m"),
        ("colour", 1.0, "motion.parameters.colour: no such parameter; allowed: radius, period"),
    ):
        with pytest.raises(ScenarioError) as refused:
            loop.edit(edited(ring, f"motion.parameters.{name}", value))
        assert str(refused.value) == said
    assert loop.system.scenario is now
    loop.step()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (PLANE.format(slope=-1.0).replace("@inline", ""), "chart is not compiled; allowed: one decorated with"),
        (CIRCLE.replace('"ring"', '"circle"'), "kind 'circle'; allowed: lower-case words joined by '-', but hold,"),
        (CIRCLE.replace("TRAJECTORY = ", "SURFACE = "), "SURFACE is OwnTrajectory("),
        (CIRCLE.replace("TRAJECTORY = ", "PATH = "), "LAW, SURFACE and TRAJECTORY are missing; allowed: a Python file"),
        (CIRCLE.replace("path, (", "path, 9 * ("), "18 parameters; allowed: 16"),
        (CIRCLE.replace("0.05, 0.0", "0.05, 0.1"), "radius = 0.05; allowed: 0.1 to 1, its bounds"),
    ],
    ids=["interpreted", "ours", "mixed up", "nothing", "many", "bounds"],
)
def test_a_file_that_cannot_be_used_is_refused(text: str, said: str, written: Callable[[str], Path]) -> None:
    with pytest.raises(OwnCodeError) as refused:
        use([written(text)])
    assert said in str(refused.value)
    assert not own_code().trajectories


def test_what_does_not_compile_is_said_with_its_line(written: Callable[[str, str], Path]) -> None:
    use([written(CIRCLE.replace("np.cos(w * t)", "np.cos(p.nothing)"), "ring")])
    with pytest.raises(OwnCodeError, match=r"ring\.py, line 10: TypingError: Unknown attribute .nothing"):
        ClosedLoop.from_scenario(edited(load("ur5-hybrid"), "motion", "own:ring"))


def test_derivatives_that_differences_do_not_confirm_are_refused(written: Callable[[str, str], Path]) -> None:
    use([written(PLANE.format(slope=-1.2), "floor")])
    with pytest.raises(ScenarioError, match=r"surface\.name: near .* its derivatives are not what differences say"):
        ClosedLoop.from_scenario(
            edited(load("ur5-hybrid"), "surface", {"kind": "own", "name": "floor", "origin": [0, 0, 0.17]})
        )


def test_the_way_out_of_a_parameter_out_of_bounds_is_the_bound() -> None:
    use([EXAMPLES / name for name in ("pid_gravity.py", "figure_eight.py", "cone.py")])
    scenario = on_surface(edited(load("ur5-hybrid"), "motion", "own:figure-eight"), "own:cone")
    corner = on_surface(load("ur5-corner"), "own:cone", "second.surface")
    for around, path, value, bound in (
        (scenario, "controller.own.pid-gravity.k_i", -1.0, 0.0),
        (scenario, "motion.parameters.height", 9.0, 0.2),
        (scenario, "surface.parameters.angle", 0.1, 0.3),
        (corner, "second.surface.parameters.angle", 5.0, 1.5),
    ):
        way = nearest(around, path, value)
        assert way is not None
        assert way.scenario is not None
        assert differences(way.scenario, around)[path][0] == bound
    assert nearest(scenario, "surface.parameters.width", 0.1) is None
