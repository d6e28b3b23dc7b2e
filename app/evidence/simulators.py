"""Comparison with two other simulators: the same controller in MuJoCo, and rigid surfaces by Pinocchio's constraint
dynamics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from app.evidence.drawing import charts_in_columns
from app.evidence.pinocchio_constraint import Kind
from app.evidence.section import EvidenceSection, Findings, Job
from app.evidence.simulator_runs import (
    FINE,
    INTO,
    LADDER,
    MASSES,
    SLIDERS,
    Constraint,
    ContactCourse,
    Free,
    Steady,
    constraint,
    contact_course,
    free,
    steady,
)
from app.export.figures import Curve, FigureChart
from app.export.sheet import thinned
from app.process.markdown import Table

ROBOTS = ("ur5", "ur10", "xarm7")
FREE, TOUCHING = 4.0, 3.0  # s
STIFFNESSES = (1e3, 3e3, 1e4, 3e4, 1e5)  # N/m
STATES = 100  # random states on each surface
TINT = ((66, 135, 245), (230, 159, 0), (0, 158, 115), (213, 94, 0), (150, 100, 220))
POINTS = 500


def jobs(thin: int) -> list[Job]:
    seconds = 1.0 if thin > 1 else FREE
    cases = [Job(free, (robot, seconds)) for robot in ROBOTS]
    cases += [Job(steady, (stiffness, TOUCHING)) for stiffness in STIFFNESSES[::thin]]
    cases += [Job(contact_course, ("at rest", "hold", MASSES[0], TOUCHING / min(thin, 3)))]
    cases += [Job(contact_course, ("on a circle", "circle", mass, TOUCHING / min(thin, 3))) for mass in MASSES]
    kinds: tuple[Kind, ...] = ("plane", "cylinder", "sphere")
    met = [*((kind,) for kind in kinds), kinds[:2], kinds]
    return cases + [Job(constraint, (each, seed, max(5, STATES // thin))) for seed, each in enumerate(met)]


def conclude(results: Sequence[Any]) -> Findings:
    moved = [found for found in results if isinstance(found, Free)]
    pressed = [found for found in results if isinstance(found, Steady)]
    touched = [found for found in results if isinstance(found, ContactCourse)]
    bound = [found for found in results if isinstance(found, Constraint)]
    numbers = {
        "euler": f"{max(found.euler for found in moved):.1g}",
        "rk4": f"{max(found.rk4 for found in moved):.1g}",
        "steps": ", ".join(f"{1.0 / substeps:g}" for substeps in LADDER),
        "fine": f"{1.0 / FINE:g}",
        "order": f"{np.mean([_order(found) for found in moved]):.2f}",
        "steady_apart": f"{max(abs(found.ours - found.mujoco) for found in pressed):.1g}",
        "steady_error": f"{max(abs(found.mujoco / found.predicted - 1.0) for found in pressed):.1g}",
        "into": f"{1e3 * INTO:g}",
        "states": f"{sum(found.states for found in bound)}",
        "bound_q": f"{max(found.q_ddot / found.largest[0] for found in bound):.1g}",
        "bound_f": f"{max(found.multiplier / found.largest[1] for found in bound):.1g}",
    }
    return Findings(
        numbers=numbers,
        tables={
            "free": _free_table(moved),
            "steady": _steady_table(pressed),
            "touch": _contact_table(touched),
            "constraint": _constraint_table(bound),
        },
        figures={"runs": _figure(moved[0], touched)},
    )


def _order(found: Free) -> float:
    """Order of the differences: the power of the step with which they shrink."""
    largest = [float(rung.max()) for rung in found.rungs]
    return float(-np.polyfit(np.log(LADDER), np.log(largest), 1)[0])


def _free_table(moved: Sequence[Free]) -> Table:
    header = (
        "largest difference of a joint angle [rad]",
        "joints moved by",
        "Euler in both",
        "Runge-Kutta in both",
        *(f"ours Euler, {1.0 / substeps:g} ms" for substeps in LADDER),
        "order",
    )
    rows = [
        (
            found.robot,
            f"{found.moved:.2f}",
            f"{found.euler:.0e}",
            f"{found.rk4:.0e}",
            *(f"{rung.max():.1e}" for rung in found.rungs),
            f"{_order(found):.2f}",
        )
        for found in moved
    ]
    return Table(header, rows)


def _steady_table(pressed: Sequence[Steady]) -> Table:
    header = ("steady force [N]", "closed form", "our plant", "MuJoCo")
    rows = [
        (f"K_e = {found.stiffness:g} N/m", *(f"{f:.5f}" for f in (found.predicted, found.ours, found.mujoco)))
        for found in pressed
    ]
    return Table(header, rows)


def _contact_table(touched: Sequence[ContactCourse]) -> Table:
    header = (
        "force control at 20 N, the tool",
        "M_e [kg]",
        "engines apart, largest [N]",
        "MuJoCo's force misses of (28) [N]",
        "the same without J̇q̇ [N]",
        "M_e n·J̇q̇, largest [N]",
    )
    rows = [
        (
            found.name,
            f"{found.mass:g}",
            *(f"{f:.1e}" for f in (found.apart, found.with_drift, found.without, found.drift)),
        )
        for found in touched
    ]
    return Table(header, rows)


def _constraint_table(bound: Sequence[Constraint]) -> Table:
    header = (
        "largest difference of",
        "its largest value",
        "any-constraint solver",
        *(f"slider of {mass:g} kg" for mass in SLIDERS),
    )
    rows = []
    for found in bound:
        for i, (what, direct) in enumerate(
            (("q̈ [rad/s²]", found.q_ddot), ("multiplier [N]", found.multiplier)),
        ):
            sliders = [f"{pair[i]:.1e}" for pair in found.by_slider] or ["—"] * len(SLIDERS)
            surfaces = ", ".join(found.kinds)
            rows.append((f"{what}: {surfaces}", f"{found.largest[i]:.3g}", f"{direct:.0e}", *sliders))
    return Table(header, rows)


def _figure(found: Free, touched: Sequence[ContactCourse]) -> bytes:
    rungs = tuple(
        Curve(f"{1.0 / substeps:g} ms", TINT[i], *_above_zero(found.t, rung))
        for i, (substeps, rung) in enumerate(zip(LADDER, found.rungs, strict=True))
    )
    circle = next(each for each in touched if each.name != "at rest")
    touching = np.flatnonzero(circle.ours > 0.0)
    few = slice(touching[0], None, max(1, len(touching) // POINTS))
    forces = (
        Curve("MuJoCo", TINT[1], circle.t[few], circle.mujoco[few], width=2.2),
        Curve("our plant", TINT[0], circle.t[few], circle.ours[few], dashed=True),
    )
    apart = tuple(
        Curve(f"{each.name}, {each.mass:g} kg", color, *_above_zero(each.t, np.abs(each.ours - each.mujoco), 1e-12))
        for each, color in zip(touched, TINT, strict=False)
    )
    charts = (
        FigureChart("joint angles apart, by our step", "rad", rungs, logarithmic=True),
        FigureChart(f"force, surface of {circle.mass:g} kg, 10 kN/m", "N", forces),
        FigureChart("forces apart", "N", apart, logarithmic=True),
    )
    caption = f"Joint angles: {found.robot} in free space, our Euler from MuJoCo's Runge-Kutta at {1.0 / FINE:g} ms."
    return charts_in_columns(charts, f"{caption} Forces: from the first touch on.")


def _above_zero(t: np.ndarray, values: np.ndarray, floor: float = 1e-9) -> tuple[np.ndarray, np.ndarray]:
    """Curve for a logarithmic axis: only its points above `floor`."""
    seen = values > floor
    return thinned(t[seen], values[seen], POINTS)


SECTION = EvidenceSection("simulators", jobs, conclude, needs={"mujoco": "pip install mujoco"})
