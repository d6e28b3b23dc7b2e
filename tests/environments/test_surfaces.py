"""The charts (phi, psi_1, psi_2) of every surface, at rest and moving."""

from __future__ import annotations

import numpy as np
import pytest

from environments.surfaces.form import SurfaceMotion
from environments.surfaces.table import Surface
from tests.support.surfaces import AT_REST, DIAGONALLY, cylinder, plane, sphere

SURFACES = ("plane", "cylinder outside", "cylinder inside", "sphere outside", "sphere inside")
MOTIONS = {"at rest": AT_REST, "moving": DIAGONALLY}
TOOL = np.array([0.5, 0.1, 0.4])
TOWARDS = np.array([0.28, 0.576, -0.768])  # from the tool to the middle of each surface, AWAY m from it
AWAY, RADIUS = 0.03, 0.4
STEP = 1e-6  # of central differences, m and s: wrong by some 1e-9 here


def surface(kind: str, motion: SurfaceMotion) -> Surface:
    name, _, where = kind.partition(" ")
    middle = TOOL + AWAY * TOWARDS
    if name == "plane":
        return plane(middle, TOWARDS, motion)
    side = 1.0 if where == "outside" else -1.0
    centre, reference = middle + side * RADIUS * TOWARDS, -side * TOWARDS
    if name == "cylinder":
        return cylinder(centre, np.array([0.0, 0.8, 0.6]), reference, RADIUS, where, motion)
    return sphere(centre, reference, RADIUS, where, motion)


@pytest.fixture(params=SURFACES)
def kind(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(params=MOTIONS)
def body(request: pytest.FixtureRequest, kind: str) -> Surface:
    return surface(kind, MOTIONS[request.param])


def near(count: int = 10) -> list[tuple[np.ndarray, float]]:
    """Points and instants around the tool."""
    random = np.random.default_rng(0)
    return [(TOOL + random.uniform(-0.15, 0.15, 3), random.uniform(0.0, 2.0)) for _ in range(count)]


def test_derivatives_in_space_and_time(body: Surface) -> None:
    for p, t in near():
        chart = body.chart(p, t)
        sides = [(body.chart(p + h, t), body.chart(p - h, t)) for h in STEP * np.eye(3)]
        for of, derivative in (("g", chart.G), ("G", chart.G_p)):
            differences = np.stack([(getattr(a, of) - getattr(b, of)) / (2 * STEP) for a, b in sides], axis=-1)
            np.testing.assert_allclose(derivative, differences, atol=1e-7, err_msg=f"{of} in space")
        after, before = body.chart(p, t + STEP), body.chart(p, t - STEP)
        for of, derivative in (("g", chart.g_t), ("G", chart.G_t), ("g_t", chart.g_tt)):
            differences = (getattr(after, of) - getattr(before, of)) / (2 * STEP)
            np.testing.assert_allclose(derivative, differences, atol=1e-7, err_msg=f"{of} in time")


def test_point_is_the_inverse_of_chart(body: Surface) -> None:
    for p, t in near():
        np.testing.assert_allclose(body.point(body.chart(p, t).g, t), p, atol=1e-12)


def test_gradient_of_phi_is_a_unit_vector_across_the_others(body: Surface) -> None:
    for p, t in near():
        G = body.chart(p, t).G
        assert np.linalg.norm(G[0]) == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(G[1:] @ G[0], 0.0, atol=1e-12)
        assert abs(np.linalg.det(G)) > 0.2


def test_phi_is_positive_inside_the_environment(kind: str) -> None:
    body = surface(kind, AT_REST)
    air, solid = body.chart(TOOL, 0.0), body.chart(TOOL + 2 * AWAY * TOWARDS, 0.0)
    assert air.g[0] == pytest.approx(-AWAY)
    assert solid.g[0] == pytest.approx(AWAY)
    np.testing.assert_allclose(air.G[0], TOWARDS, atol=1e-12)


def test_mesh_lies_on_the_surface(body: Surface) -> None:
    vertices, faces = body.mesh(TOOL, 0.3)
    phi = [body.chart(v + body.motion.offset(0.3), 0.3).g[0] for v in vertices]
    np.testing.assert_allclose(phi, 0.0, atol=1e-12)
    assert set(faces.ravel()) == set(range(len(vertices)))
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 0.0


def test_moving_surface_carries_its_coordinates(body: Surface) -> None:
    for p, t in near():
        carried = p + body.motion.offset(t) - body.motion.offset(0.0)
        np.testing.assert_allclose(body.chart(carried, t).g, body.chart(p, 0.0).g, atol=1e-12)


def test_a_reference_along_the_axis_is_refused() -> None:
    axis = np.array([0.0, 1.0, 0.0])
    with pytest.raises(ValueError, match=r"surface\.reference.*parallel to the axis"):
        cylinder(np.zeros(3), axis, 2 * axis, 0.3, "outside")
