"""Convergence of the plant's integrators, the sampled loop and the sliding band to the paper's differential equation.

The equation is written a second time in `app/evidence/independent_simulator.py`, in plain numpy, and solved by DOP853.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from app.evidence.drawing import charts_in_columns
from app.evidence.independent_simulator import order
from app.evidence.section import EvidenceSection, Findings, Job
from app.evidence.twins import Twin, bands, loop_errors, plant_errors
from app.export.figures import Curve, FigureChart
from app.process.markdown import Table
from app.scenario.data import edited, shipped
from environments.integrators import IntegratorName

CONTACTS: Mapping[str, tuple[Mapping[str, Any], tuple[int, ...]]] = {  # of the twin; plant steps in SPAN
    "elastic, moving sphere": ({"mode": "hybrid"}, (16, 32, 64, 128)),
    "mass of 3 kg, moving sphere": ({"mode": "hybrid", "M_e": 3.0, "ideal": True}, (16, 32, 64, 128)),
    # smooth, so that more steps would meet the reference's own error
    "rigid sphere": ({"mode": "constrained", "moving": False, "ideal": True}, (4, 8, 16)),
}
SPAN = 0.04  # s under a constant torque
PERIODS = (0.002, 0.001, 0.0005, 0.00025)  # s
LOOP_SPAN = 0.2  # s
SINCE, UNTIL = 0.15, 0.4  # s, between which the sliding band is measured
BANDS = (
    ("ur5-motion-discontinuous", 20.0),
    ("ur5-motion-discontinuous", 60.0),
    ("planar2r-semicircle-discontinuous", 20.0),
)  # scenario, d N

ORDERS: Mapping[IntegratorName, float] = {"leapfrog": 1.0, "semi-implicit-euler": 1.0, "rk4": 4.0}
NAMES: Mapping[IntegratorName, str] = {"leapfrog": "leapfrog", "semi-implicit-euler": "Euler", "rk4": "RK4"}
Subject = Literal["plant", "loop", "band"]
SUBJECTS: Mapping[Subject, str] = {
    "plant": "plant: error of (q, q̇) [rad, rad/s]",
    "loop": "sampled loop: error of q [rad]",
    "band": "sliding band: largest ‖s‖ [m/s]",
}
CAPTION = (
    "Dots: measured; of one colour the upper ones are semi-implicit Euler's, the lower ones RK4's, and the leapfrog's "
    "between them: on a rigid surface on those of Euler in the plant's chart, near those of RK4 in the loop's. The "
    "sliding band is the leapfrog's. Dashed: the slope "
    "that theory gives, 4 for the plant under RK4 and 1 everywhere else, through the shortest step."
)

COLORS = ((66, 135, 245), (230, 159, 0), (0, 158, 115))
THEORY = (120, 120, 120)


@dataclass(frozen=True)
class Decline:
    """Decline of an error with the step.
    steps: (N,) s, from the longest to the shortest.
    errors: (N,), one for each step.
    slope: of log(error) over log(step).
    expected: slope by theory."""

    subject: Subject
    name: str
    integrator: IntegratorName
    steps: np.ndarray
    errors: np.ndarray
    slope: float
    expected: float


def of_plant(contact: str, integrator: IntegratorName) -> Decline:
    """Decline of the largest error of (q, q_dot) (rad, rad/s) after `SPAN` under a constant torque."""
    substeps = CONTACTS[contact][1]
    errors = plant_errors(_twin(contact, integrator), substeps, SPAN)
    return _decline("plant", contact, integrator, SPAN / np.array(substeps), errors, ORDERS[integrator])


def of_loop(contact: str, integrator: IntegratorName) -> Decline:
    """Decline of the largest error of q (rad) within `LOOP_SPAN` in the sampled loop, which holds the torque over a
    period and integrates z by Euler's method."""
    errors = loop_errors(_twin(contact, integrator), PERIODS, LOOP_SPAN)
    return _decline("loop", contact, integrator, np.array(PERIODS), errors, 1.0)


def of_band(name: str, d: float) -> Decline:
    """Decline of the largest ||s|| (m/s) under the discontinuous law with a constant gain d (N)."""
    scenario = edited(edited(shipped()[name], "simulation.duration", UNTIL), "controller.gain", "constant")
    errors = bands(edited(scenario, "controller.d", d), PERIODS, since=SINCE)
    name = f"{name.removesuffix('-discontinuous')}, d = {d:g} N"
    return _decline("band", name, scenario.simulation.integrator, np.array(PERIODS), errors, 1.0)


def _decline(
    subject: Subject, name: str, integrator: IntegratorName, steps: np.ndarray, errors: np.ndarray, expected: float
) -> Decline:
    return Decline(subject, name, integrator, steps, errors, order(steps, errors), expected)


def _twin(contact: str, integrator: IntegratorName) -> Twin:
    return Twin("ur5", radius=0.3, integrator=integrator, **CONTACTS[contact][0])


def jobs(thin: int) -> list[Job]:
    loops = [(contact, integrator) for contact in CONTACTS for integrator in ORDERS][::thin]
    return [
        *(Job(function, arguments) for function in (of_plant, of_loop) for arguments in loops),
        *(Job(of_band, arguments) for arguments in BANDS[::thin]),
    ]


def conclude(results: Sequence[Decline]) -> Findings:
    of: dict[Subject, list[Decline]] = {
        subject: [found for found in results if found.subject == subject] for subject in SUBJECTS
    }
    return Findings(
        numbers={
            f"{subject}_slopes": f"{min(d.slope for d in declines):.2f} to {max(d.slope for d in declines):.2f}"
            for subject, declines in of.items()
        },
        tables={subject: _table(SUBJECTS[subject], declines) for subject, declines in of.items()},
        figures={"orders": charts_in_columns(tuple(map(_chart, SUBJECTS, of.values())), CAPTION)},
    )


def _table(what: str, declines: Sequence[Decline]) -> Table:
    rows = [
        (
            f"{found.name}, {NAMES[found.integrator]}",
            *(f"{1e3 * found.steps[i]:.3g}" for i in (0, -1)),
            *(f"{found.errors[i]:.2g}" for i in (0, -1)),
            f"{found.slope:.2f}",
            f"{found.expected:g}",
        )
        for found in declines
    ]
    return Table((what, "longest step [ms]", "shortest", "error there", "and there", "slope", "by theory"), rows)


def _chart(subject: Subject, declines: Sequence[Decline]) -> FigureChart:
    title, unit, x_label = {
        "plant": ("plant, constant torque: error of (q, q̇)", "rad, rad/s", "plant step [ms]"),
        "loop": ("sampled loop: error of q", "rad", "control period T [ms]"),
        "band": ("discontinuous law: largest ‖s‖", "mm/s", "control period T [ms]"),
    }[subject]
    factor = 1e3 if subject == "band" else 1.0
    theory, measured, colors = [], [], dict(zip(dict.fromkeys(d.name for d in declines), COLORS, strict=False))
    for found in declines:
        steps, errors = 1e3 * found.steps, factor * found.errors
        expected = errors[-1] * (steps / steps[-1]) ** found.expected
        listed = found.name not in [curve.name for curve in measured]
        theory.append(Curve("", THEORY, steps, expected, dashed=True, width=0.7, listed=False))
        measured.append(Curve(found.name, colors[found.name], steps, errors, width=0.0, listed=listed, dotted=True))
    return FigureChart(title, unit, (*theory, *measured), x_label=x_label, logarithmic=True, logarithmic_x=True)


SECTION = EvidenceSection("convergence", jobs, conclude)
