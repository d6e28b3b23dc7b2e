"""Check of the true arm against the declared bounds: the theorem promises something only for an arm within them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from app.scenario.schema import Scenario
from app.scenario.units import Units
from environments.sensors import ForceSensor
from parameters import Matrix

SPREAD = 4.0  # of three normal numbers, the norm stays below this many standard deviations 99.9 % of the time
ROUNDING = 1e-9


def outside(scenario: Scenario, units: Units) -> tuple[str, ...]:
    """Violated inequalities between truth and declaration, each with both numbers; none when all hold.
    units: of the arm's joints.

    Of the force sensor only bias and noise are judged, the noise by `SPREAD`: the effect of delay and low-pass depends
    on how fast the force changes. An ideal reading of a rigid or heavy surface has neither.
    """
    return tuple(
        f"{what} {true:.4g}{unit} > declared {declared:.4g}{unit}"
        for what, true, declared, unit in _inequalities(scenario, units)
        if true > declared + ROUNDING
    )


def link_rows(given: Matrix) -> np.ndarray | None:
    """Rows (k, width) of a field with one row for all links or one each; None where they are not equally long."""
    rows = [np.atleast_1d(np.array(row, dtype=float)) for row in given]
    if all(len(row) == 1 for row in rows):
        rows = [np.concatenate(rows)] if rows else []
    return np.stack(rows) if rows and len({len(row) for row in rows}) == 1 else None


def symmetric(rows: np.ndarray) -> np.ndarray:
    """Symmetric matrices (k, 3, 3) of their entries xx, yy, zz, xy, xz, yz (k, 6)."""
    return rows[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]


def entries(matrices: np.ndarray) -> np.ndarray:
    """Entries (k, 6) of symmetric matrices (k, 3, 3), see `symmetric`."""
    return matrices[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def _inequalities(scenario: Scenario, units: Units) -> Iterator[tuple[str, float, float, str]]:
    """Inequalities that can be judged before the run; of bounds that are stated in place of others, the run itself
    judges those (`app.simulation.promise.true_errors`)."""
    declared, sensor = scenario.declared, scenario.sensor
    if None in (declared.delta_M, declared.delta_C, declared.delta_G):
        yield from _of_links(scenario)
    if declared.delta_f is None:
        true = scenario.truth
        torque, damping = (f" {units.of_joints(unit)}" for unit in ("N·m", "N·m·s/rad"))
        yield "Coulomb friction", true.coulomb, declared.coulomb, torque
        yield "viscous friction", true.viscous, declared.viscous, damping
        yield "disturbance", true.disturbance, declared.disturbance, torque
    if sensor.ideal and any(each.contact.nature.heavy for each in scenario.surfaces):
        return  # the reading is the force of the period itself
    kept = SPREAD * ForceSensor(sensor, scenario.controller.period).noise_share
    formula = f"(bias + {SPREAD:g}σ of noise)"
    error = float(np.linalg.norm(sensor.bias)) + kept * sensor.noise
    yield f"force error {formula}", error, declared.force_error, " N"
    error = float(np.linalg.norm(sensor.moment_bias)) + kept * sensor.moment_noise
    yield f"moment error {formula}", error, declared.moment_error, " N·m"


def _of_links(scenario: Scenario) -> Iterator[tuple[str, float, float, str]]:
    true, declared = scenario.truth, scenario.declared
    for what, of, factors, most in (
        ("link scaling", "link", true.link_scaling, declared.link_scaling),
        ("rotor scaling", "joint", true.rotor_scaling, declared.rotor_scaling),
    ):
        scaling = np.atleast_1d(np.array(factors, dtype=float))
        worst = int(np.abs(scaling - 1.0).argmax())
        which = f"{what} of {of} {worst + 1}" if len(scaling) > 1 else what
        yield f"{which} |{scaling[worst]:.4g} − 1| =", abs(scaling[worst] - 1.0), most, ""
    if (shifts := link_rows(true.link_centre)) is not None:
        distances = np.linalg.norm(shifts, axis=1)
        yield _of_link("centre of mass", distances), float(distances.max()), declared.link_centre, " m"
    if (shapes := link_rows(true.link_shape)) is not None and shapes.shape[1] == 6:
        sizes = np.abs(np.linalg.eigvalsh(symmetric(shapes))).max(axis=1)
        yield _of_link("shape of the inertia", sizes), float(sizes.max()), declared.link_shape, ""
    yield "payload", true.payload_mass, declared.payload_mass, " kg"
    if true.payload_mass > 0.0:
        distance = float(np.linalg.norm(true.payload_offset))
        yield "payload offset", distance, declared.payload_offset, " m"


def _of_link(what: str, sizes: np.ndarray) -> str:
    """Words for the largest of these sizes, one for all links or one each."""
    return f"{what} of link {int(sizes.argmax()) + 1} off by" if len(sizes) > 1 else f"{what} off by"
