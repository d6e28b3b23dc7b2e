"""Options of the scene and the plots: state of the page, the same for all its visitors, and never part of a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

FINE, LIGHT = 0.0035, 0.015  # m: a mesh shows no detail finer than this; for a UR5 34,000 and 8,000 triangles

NEWTON_METRES = 2.5  # per 100 mm of an arrow that is the axis of a moment

Drag = Literal["push", "target", "turn"]


@dataclass(frozen=True)
class SceneOptions:
    """Options of the scene.
    spring: whether the target model's spring and damper are drawn.
    times: their length over the deflection.
    newtons: force of an arrow of 100 mm, None for a scale that suits the forces.
    cell: m, see `FINE`.
    drag: action of the mouse on the tool; with Shift held, a push, or, where it is a push already, a move of the
    target.
    stiffness, limit: N/m and N, of the spring by which the mouse pushes.
    torsion, moment_limit: N m/rad and N m, of the torsional spring by which the mouse turns the tool."""

    ghost: bool = False
    pinned_arms: bool = True
    desired_path: bool = True
    tool_path: bool = True
    error_colors: bool = True
    forces: bool = True
    frame: bool = True
    surface: bool = True
    grid: bool = True
    spring: bool = True
    times: float = 1.0
    newtons: float | None = None
    cell: float = FINE
    drag: Drag = "push"
    stiffness: float = 500.0
    limit: float = 60.0
    torsion: float = 30.0
    moment_limit: float = 5.0


@dataclass(frozen=True)
class Legend:
    """Legend of the scene: the present meaning of its colours and lengths.
    error: m, of the last colour.
    newtons: force per 100 mm of arrow.
    ghost: distance of arm and ghost, m, or in words why there is none; None where none is wanted."""

    error: float
    newtons: float
    ghost: float | str | None


class Viewing:
    """View options of the page.
    scene_options: see `SceneOptions`.
    legend: of the last drawing of the scene.
    window: s, length of the plots.
    coordinate, joint: numbers, from 0, of those that the plots show."""

    def __init__(self) -> None:
        self.scene_options = SceneOptions()
        self.window = 8.0
        self.coordinate = self.joint = 0
        self.legend = Legend(1e-4, 10.0, None)


def rounded_up(value: float, least: float) -> float:
    """The smallest of 1, 2, 5, 10, 20 ... times `least` that is not below the value."""
    step = least
    while step < value * (1.0 - 1e-9):
        mantissa = round(step / least)
        while mantissa % 10 == 0:
            mantissa //= 10
        step *= 2.5 if mantissa == 2 else 2.0
    return step
