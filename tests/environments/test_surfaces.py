"""The charts (phi, psi_1, psi_2) of every surface, at rest and moving."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from environments.surfaces.carried import carry
from environments.surfaces.form import SurfaceMotion
from environments.surfaces.formula import FormulaSurface
from environments.surfaces.plane import Plane, Tilt
from environments.surfaces.table import Surface
from kernels import kernel
from kernels.records import Record
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


@kernel
def _carry_alone(shapes, chart, p, t, velocity, into):
    into[0] = carry(shapes[0].first, chart[0], p, t, velocity)


def carried(body: Surface, p: np.ndarray, t: float, velocity: np.ndarray) -> float:
    """Velocity (3,) m/s, written, and acceleration along phi, m/s^2, of the surface's point at p."""
    into = np.empty(1)
    _carry_alone(Record(body.shapes).data, Record(body.chart(p, t)).data, p, t, velocity, into)
    return float(into[0])


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


def test_velocity_and_acceleration_of_the_surfaces_point_at_the_tool() -> None:
    """Those of a point that is fixed to a plane which moves and turns about an oblique axis."""
    tilt = Tilt(amplitude=0.4, frequency=1.5, axis=(0.3, -0.5, 0.8))
    form = Plane(origin=tuple(TOOL), normal=tuple(TOWARDS), motion=DIAGONALLY, tilt=tilt)
    body, axis = Surface.of(form, TOOL), np.array(tilt.axis) / np.linalg.norm(tilt.axis)

    def turned(t: float) -> np.ndarray:
        return pin.AngleAxis(tilt.amplitude * np.sin(2 * np.pi * tilt.frequency * t), axis).toRotationMatrix()

    for p, t in near():
        fixed, velocity = turned(t).T @ (p - body.origin - body.motion.offset(t)), np.zeros(3)
        chart, h = body.chart(p, t), 1e-4
        before, here, after = (body.origin + body.motion.offset(at) + turned(at) @ fixed for at in (t - h, t, t + h))
        into = carried(body, p, t, velocity)
        np.testing.assert_allclose(velocity, (after - before) / (2 * h), atol=1e-5)
        assert into == pytest.approx(chart.G[0] @ (after - 2 * here + before) / h**2, abs=1e-4)


def test_a_plane_by_a_formula_that_rises_is_accelerated_like_a_plane_that_moves() -> None:
    motion = SurfaceMotion(direction=(0.0, 0.0, 1.0), amplitude=0.02, frequency=0.7)
    moved = Surface.of(Plane(origin=(0.5, 0.1, 0.4), normal=(0.0, 0.0, -1.0), motion=motion), TOOL)
    typed = FormulaSurface(origin=(0.5, 0.1, 0.4), normal=(0.0, 0.0, -1.0), text="z - 0.02*sin(2*pi*0.7*t)")
    for p, t in near():
        into = [carried(body, p, t, np.zeros(3)) for body in (moved, Surface.of(typed, TOOL))]
        assert abs(into[0]) > 1e-3
        assert into[1] == pytest.approx(into[0], rel=1e-9)
