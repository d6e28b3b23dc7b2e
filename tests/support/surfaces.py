"""Surfaces from arrays, where a scenario would have lists."""

from __future__ import annotations

import numpy as np

from app.scenario.data import from_plain, to_plain
from app.scenario.schema import Scenario
from environments.surfaces.cylinder import Cylinder
from environments.surfaces.form import SurfaceMotion
from environments.surfaces.formula import FormulaSurface
from environments.surfaces.plane import Plane
from environments.surfaces.sphere import Sphere
from environments.surfaces.table import Surface

AT_REST = SurfaceMotion()
DIAGONALLY = SurfaceMotion(direction=(0.6, 0.48, 0.64), amplitude=0.03, frequency=1.7)


def triple(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = np.asarray(vector, dtype=float).tolist()
    return x, y, z


def plane(origin: np.ndarray, normal: np.ndarray, motion: SurfaceMotion = AT_REST) -> Surface:
    return Surface.of(Plane(origin=triple(origin), normal=triple(normal), motion=motion))


def cylinder(
    origin: np.ndarray,
    axis: np.ndarray,
    reference: np.ndarray,
    radius: float,
    side: str,
    motion: SurfaceMotion = AT_REST,
) -> Surface:
    towards = triple(reference)
    return Surface.of(
        Cylinder(origin=triple(origin), axis=triple(axis), reference=towards, radius=radius, side=side, motion=motion)
    )


def sphere(
    origin: np.ndarray, reference: np.ndarray, radius: float, side: str, motion: SurfaceMotion = AT_REST
) -> Surface:
    return Surface.of(
        Sphere(origin=triple(origin), reference=triple(reference), radius=radius, side=side, motion=motion)
    )


def formula(
    text: str,
    origin: np.ndarray,
    normal: np.ndarray,
    near: np.ndarray,
    motion: SurfaceMotion = AT_REST,
    solid: str = "below",
) -> Surface:
    form = FormulaSurface(text=text, origin=triple(origin), normal=triple(normal), solid=solid, motion=motion)
    return Surface.of(form, near)


def to_third(scenario: Scenario) -> Scenario:
    """The scenario with its second surface as the third one."""
    data = to_plain(scenario)
    data["third"], data["second"] = data["second"], to_plain(Scenario())["second"]
    return from_plain(data)
