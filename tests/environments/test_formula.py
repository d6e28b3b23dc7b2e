"""Surfaces typed as formulas: what may be typed, its derivatives, and the surface that it means."""

from __future__ import annotations

import re
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from app.scenario.data import edited, from_plain, from_toml, shipped, to_plain, to_toml
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.changes import on_surface
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from environments.bytecode import OUTPUTS, bytecode_of, run
from environments.formula import FormulaError, parse
from environments.surfaces.form import SurfaceMotion
from environments.surfaces.plane import Plane
from environments.surfaces.table import Surface
from kernels import kernel
from kernels.records import Record
from tests.support.cases import scenario_of
from tests.support.surfaces import AT_REST, DIAGONALLY, cylinder, formula, plane, sphere

TOOL = np.array([0.5, 0.1, 0.2])
DOWN = np.array([0.0, 0.0, -1.0])
MOVING = DIAGONALLY
WAVES = (
    "z - 0.2 - 0.02*sin(6*x - 2*t)",
    "2*z - 0.4 - 0.03*sin(6*x - 2*t)*cos(5*y + t) + 0.01*exp(-(x^2 + y^2)/0.1)*tanh(t)",
    "z^3 - (0.2 + 0.01*sin(20*hypot(x - 0.4, y) - 3*t))^3",
)


@kernel
def _run_alone(bytecode, x, y, z, t):
    run(bytecode[0], x, y, z, t)


def outputs(text: str, *at: float) -> np.ndarray:
    """In the order of `OUTPUTS`."""
    record = Record(bytecode_of(parse(text)))
    _run_alone(record.data, *map(float, at))
    return record.read().registers[record.read().outputs]


def typed(
    text: str, motion: SurfaceMotion = AT_REST, solid: str = "below", origin: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> Surface:
    return formula(text, np.array(origin), DOWN, TOOL, motion, solid)


def near(count: int = 12, within: float = 0.08) -> list[tuple[np.ndarray, float]]:
    random = np.random.default_rng(0)
    return [(TOOL + random.uniform(-within, within, 3), random.uniform(0.0, 2.0)) for _ in range(count)]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 + 2*x - y/4", 1 + 2 * 0.3 + 0.7 / 4),
        ("-x^2", -(0.3**2)),
        ("x**2**3", 0.3**8),
        ("2^-1*x", 0.15),
        ("x - y - z", 0.3 + 0.7 - 1.1),
        ("x/y/z", 0.3 / -0.7 / 1.1),
        ("--x - +y", 0.3 + 0.7),
        ("sin(pi*x) + cos(t)", np.sin(np.pi * 0.3) + np.cos(0.5)),
        ("hypot(x, y)*sqrt(z)*exp(x)", np.hypot(0.3, -0.7) * np.sqrt(1.1) * np.exp(0.3)),
        ("log(z) + tan(x) + tanh(y) + atan(y)", np.log(1.1) + np.tan(0.3) + np.tanh(-0.7) + np.arctan(-0.7)),
        ("y^3 + z^1.5 + .5e-1", (-0.7) ** 3 + 1.1**1.5 + 0.05),
    ],
)
def test_what_a_text_means(text: str, value: float) -> None:
    assert outputs(text, 0.3, -0.7, 1.1, 0.5)[0] == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "is empty; allowed"),
        ("2x", '"x" at character 2 where an operator'),
        ("(z", r'ends where "\)" is needed'),
        ("z)", r'"\)" at character 2'),
        ("z - a", '"a" at character 5 is unknown; allowed: numbers'),
        ("abs(z)", '"abs" at character 1 is unknown'),
        ("__import__('os')", "character 12 cannot be read"),
        ("z.real", r"'\.' at character 2 cannot be read"),
        ("ｚ", "cannot be read"),
        ("z^x", "exponent at character 3 depends on"),
        ("z^101", "exponent at character 3 is 101"),
        ("sin(x, y)", "sin at character 1 has 2 arguments; allowed: 1"),
        ("z/(1 - 1)", "character 2 stands a division by 0"),
        ("z + log(-1)", "character 5 stands what is no real number"),
        ("exp(1000)*z", "character 1 stands a number that is too large"),
        ("1e400", "numbers up to 1e"),
        ("(" * 200 + "z" + ")" * 200, "more than 40 levels"),
        ("-" * 300 + "z", "more than 40 levels"),
        ("(" * 100_000, "100000 characters; allowed: 500"),
        ("/".join(["(x + y*z*t)"] * 40), "operations and .* numbers; allowed: 512"),
    ],
)
def test_what_is_refused(text: str, sentence: str) -> None:
    with pytest.raises(FormulaError, match=sentence):
        bytecode_of(parse(text))


@given(st.one_of(st.text(max_size=60), st.text("xyzt()+-*/^., 0129episncohgqrtal", max_size=40)))
@settings(max_examples=400, deadline=None)
def test_whatever_is_typed_is_a_formula_of_finite_numbers_or_a_formula_error(text: str) -> None:
    with suppress(FormulaError):
        assert np.isfinite(bytecode_of(parse(text)).registers).all()


def _texts() -> st.SearchStrategy[str]:
    leaves = st.sampled_from(["x", "y", "z", "t", "0.7", "2", "pi"])

    def grown(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
        pairs = st.tuples(inner, st.sampled_from("+-*"), inner).map(lambda p: f"({p[0]} {p[1]} {p[2]})")
        safe = st.tuples(inner, inner).map(lambda p: f"({p[0]})/(2 + ({p[1]})^2)")
        calls = st.tuples(st.sampled_from(["sin", "cos", "tanh", "atan"]), inner).map(lambda p: f"{p[0]}({p[1]})")
        roots = st.tuples(st.sampled_from(["sqrt", "log"]), inner).map(lambda p: f"{p[0]}(1 + ({p[1]})^2)")
        forms = st.sampled_from(["-({})^3", "exp(-({})^2)", "hypot({}, 1)", "tan(atan({})/2)", "(2 + sin({}))^1.5"])
        others = st.tuples(forms, inner).map(lambda p: p[0].format(p[1]))
        return st.one_of(pairs, safe, calls, roots, others)

    return st.recursive(leaves, grown, max_leaves=5)


NAMES = {name: getattr(np, name) for name in ("sin", "cos", "tan", "tanh", "exp", "log", "sqrt")}
NAMES |= {"atan": np.arctan, "hypot": lambda a, b: np.sqrt(a * a + b * b), "pi": np.pi}


@given(_texts(), st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4))
@settings(max_examples=150, deadline=None)
def test_derivatives_are_those_of_the_same_text_in_numpy(text: str, at: list[float]) -> None:
    """First ones by complex steps, second ones as differences of these."""
    try:
        derivatives = outputs(text, *at)
    except FormulaError:  # a large one
        assume(False)

    def gradient(p: np.ndarray) -> np.ndarray:
        turned = p + 1e-30j * np.eye(4)
        values = [eval(text.replace("^", "**"), NAMES, dict(zip("xyzt", q, strict=True))) for q in turned]  # ours
        return np.imag(values) / 1e-30

    h, first = 1e-5, gradient(np.array(at))
    second = np.array([gradient(at + e) - gradient(at - e) for e in h * np.eye(4)]) / (2 * h)
    size = 1.0 + max(np.abs(first).max(), np.abs(second).max())
    for variables, derivative in zip(OUTPUTS[1:], derivatives[1:], strict=True):
        if len(variables) == 1:
            assert derivative == pytest.approx(first[variables[0]], abs=1e-11 * size)
        else:
            assert derivative == pytest.approx(second[variables], abs=1e-5 * size**2)


LIKE = {
    "plane": (typed("3*z", MOVING, "below", (0, 0, 0.2)), plane(np.array([0, 0, 0.2]), DOWN, MOVING)),
    "plane by its formula": (
        typed("z - 0.02*sin(pi*t)", AT_REST, "below", (0, 0, 0.2)),
        plane(np.array([0, 0, 0.2]), DOWN, SurfaceMotion(amplitude=0.02, frequency=0.5)),
    ),
    "cylinder": (
        typed("x^2 + z^2 - 0.09", MOVING, "below", (0.5, 0, -0.1)),
        cylinder(np.array([0.5, 0, -0.1]), np.array([0, 1.0, 0]), -DOWN, 0.3, "outside", MOVING),
    ),
    "inside of a sphere": (
        typed("exp(x^2 + y^2 + z^2) - exp(0.09)", MOVING, "above", (0.5, 0.1, 0.5)),
        sphere(np.array([0.5, 0.1, 0.5]), DOWN, 0.3, "inside", MOVING),
    ),
}


@pytest.mark.parametrize("pair", LIKE.values(), ids=LIKE)
def test_phi_is_the_distance_however_the_surface_is_written(pair: tuple[Surface, Surface]) -> None:
    for p, t in near():
        formula, shape = (body.chart(p, t) for body in pair)
        for name in set(formula._fields) - {"deforming"}:  # a formula may move itself, a plane is moved
            rows = slice(None) if isinstance(pair[1].form, Plane) else 0  # psi of the round ones are arcs
            np.testing.assert_allclose(getattr(formula, name)[rows], getattr(shape, name)[rows], atol=1e-9)


@pytest.mark.parametrize("motion", [AT_REST, MOVING], ids=["at rest", "moving"])
@pytest.mark.parametrize("text", WAVES)
def test_chart(text: str, motion: SurfaceMotion) -> None:
    """Derivatives in space and time, unit gradient, the inverse, and the drawn points."""
    body, h = typed(text, motion), 1e-6
    for p, t in near(6, 0.04):
        chart = body.chart(p, t)
        assert np.linalg.norm(chart.G[0]) == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(body.point(chart.g, t), p, atol=1e-11)
        sides = [(body.chart(p + e, t), body.chart(p - e, t)) for e in h * np.eye(3)]
        sides.append((body.chart(p, t + h), body.chart(p, t - h)))
        for of, derivative in (
            ("g", np.column_stack([chart.G, chart.g_t])),
            ("G", np.concatenate([chart.G_p, chart.G_t[:, :, None]], axis=2)),
            ("g_t", np.column_stack([chart.G_t, chart.g_tt])),
        ):
            differences = np.stack([(getattr(a, of) - getattr(b, of)) / (2 * h) for a, b in sides], axis=-1)
            np.testing.assert_allclose(derivative, differences, atol=2e-7, err_msg=of)
    vertices, faces = body.mesh(TOOL, 0.7)
    assert len(faces) == 2 * (body.resolution - 1) ** 2
    on = [body.chart(v + motion.offset(0.7), 0.7).g[0] for v in vertices]
    np.testing.assert_allclose(on, 0.0, atol=1e-12)


def test_a_surface_that_ends_is_drawn_as_far_as_it_goes() -> None:
    body = typed("x^2 + y^2 + z^2 - 0.04", AT_REST, "below", (0.5, 0.1, 0.0))
    vertices, faces = body.mesh(TOOL, 0.0)
    used = vertices[np.unique(faces)]
    np.testing.assert_allclose(np.linalg.norm(used - [0.5, 0.1, 0.0], axis=1), 0.2, atol=1e-12)
    assert 0.3 < len(used) / len(vertices) < 0.6
    assert not body.changing
    assert typed(WAVES[0]).changing


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("t + 1", "depends on none of x, y, z"),
        ("z + 5", "does not meet the surface"),
        ("z - 0.2 - 0.06*t", "at t = .* does not meet the surface"),
        ("(z - 0.2)^3", "not smooth|gradient vanishes"),
        ("z - 0.2 - 0.001*sin(1000*x)", "larger radii of curvature"),
        ("z - 0.2 - 30*(x - 0.5)", "parallel to surface.normal"),
        ("z - 0.3", "0.1 m inside the solid"),
    ],
)
def test_what_is_no_surface_for_the_tool(text: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        typed(text).require_regular(10.0)


def rows(scenario: Scenario, steps: int = 300) -> dict[str, np.ndarray]:
    loop = ClosedLoop.from_scenario(scenario)
    for _ in range(steps):
        loop.step()
        assert loop.stopped is None
    return loop.recording.signals(("q", "F"))


def replaced(scenario: Scenario, surface: dict[str, object]) -> Scenario:
    return from_plain(to_plain(scenario) | {"surface": surface})


@pytest.mark.parametrize("case", ["hybrid/elastic", "constrained/rigid", "hybrid-impedance/mass-damper-spring"])
def test_a_plane_as_a_formula_makes_the_same_run(case: str) -> None:
    scenario = scenario_of("ur5", *case.split("/"), "moving plane")
    origin = scenario.surface.origin
    moving = f"5*(z - {origin[2]!r} - 0.01*sin(2*pi*t))"
    one = rows(scenario)
    other = rows(replaced(scenario, {"kind": "formula", "text": moving}))
    np.testing.assert_allclose(one["q"], other["q"], atol=1e-9)
    np.testing.assert_allclose(one["F"], other["F"], atol=1e-6)
    assert np.abs(one["F"]).max() > 1.0


def test_a_sphere_as_a_formula_makes_the_same_run() -> None:
    scenario = scenario_of("ur5", "impedance", "elastic", "moving sphere")
    surface = to_plain(scenario)["surface"]
    text = "x^2 + y^2 + z^2 - 0.09"
    typed_surface = {"kind": "formula", "text": text, "origin": surface["origin"], "motion": surface["motion"]}
    one, other = rows(scenario), rows(replaced(scenario, typed_surface))
    np.testing.assert_allclose(one["q"], other["q"], atol=1e-9)
    assert np.abs(one["F"]).max() > 1.0


def test_a_scenario_keeps_its_formula_and_names_the_field_of_a_wrong_one() -> None:
    scenario = shipped()["ur5-wave"]
    assert from_toml(to_toml(scenario)) == scenario
    with pytest.raises(ScenarioError, match=r'^surface\.text: "q" at character 5 is unknown'):
        assemble(edited(scenario, "surface.text", "z - q"))
    with pytest.raises(ScenarioError, match=r"^surface\.text: .* inside the solid"):
        assemble(edited(scenario, "surface.text", "z - 0.4"))


def test_a_surface_that_nothing_meets_need_not_be_near() -> None:
    scenario = from_plain({"surface": {"kind": "formula", "text": "z + 5"}})
    assert not assemble(scenario).mode.on_surface


@pytest.mark.parametrize("kind", ["plane", "cylinder", "sphere", "formula"])
def test_another_kind_of_surface_comes_to_the_tool(kind: str) -> None:
    before = assemble(shipped()["ur5-hybrid-moving"])
    system = assemble(on_surface(before.scenario, kind))
    p = before.nominal.evaluate(before.q_0, np.zeros(6)).p
    assert system.surface.chart(p, 0.0).g[0] == pytest.approx(before.surface.chart(p, 0.0).g[0], abs=1e-3)
    assert system.scenario.surface.motion == before.scenario.surface.motion
    with pytest.raises(ScenarioError, match=re.escape("surface")):
        on_surface(before.scenario, "torus")
