"""Checks of a scenario's environment: whether an arm in this mode can have its surfaces, contacts, forces and tool."""

from __future__ import annotations

from typing import Literal

import numpy as np

from app.scenario.admitted_contacts import admitted_contacts
from app.scenario.data import kind_of
from app.scenario.errors import ForceInJoints, IrregularCorner, PullingForce, ScenarioError, WrongFace
from app.scenario.field_info import field_info
from app.scenario.schema import Scenario
from app.simulation.builders.environment_builder import SOFTEST, believed_matrix, environment_of, task_joints
from controllers.modes import IN_JOINTS, Mode
from environments import robots
from environments.contact import face_radius
from environments.contact_kinds import CONTACTS, FREE

ROUNDED = 1e-12  # of a matrix's largest eigenvalue, by which rounding moves the least one


def require_surfaces(scenario: Scenario, mode: Mode, positions: int, n: int) -> None:
    """Raise ScenarioError unless an arm with n joints can meet the scenario's surfaces in this mode. positions: number
    of coordinates that are positions."""
    first, *further = scenario.surfaces
    require_stiff(scenario, mode)
    pressed = first.pressed
    for each in further:
        kind = each.contact.kind
        if not first.contact.nature.touches:
            raise ScenarioError(f"{each.path}contact.kind: {kind!r} without a first surface; allowed: {FREE!r}")
        if kind not in admitted_contacts(mode):
            allowed = ", ".join(admitted_contacts(mode))
            raise ScenarioError(f"{each.path}contact.kind: {kind!r} in {mode.name} mode; allowed: {allowed}")
        if each.pressed and not pressed:
            raise ScenarioError(
                f"{each.path}control: 'force' after a surface with 'path'; allowed: 'path', or first those surfaces "
                "whose force is controlled"
            )
        if not each.pressed and each.contact.nature.rigid:
            raise ScenarioError(f"{each.path}control: 'path' on a rigid surface; allowed: 'force'")
        pressed = each.pressed
    if first.contact.nature.rigid and len(further) + 1 >= n:
        raise IrregularCorner(
            f"{further[-1].path}contact.kind: {further[-1].contact.kind!r} on {len(further) + 1} surfaces holds all "
            f"{n} joints of this arm; allowed: fewer rigid surfaces than joints"
        )
    if len(further) >= positions:
        raise ScenarioError(
            f"{further[-1].path}contact.kind: {further[-1].contact.kind!r}, the surface number {len(further) + 1}; "
            f"allowed with this arm: {FREE!r}, it has {positions} positions"
        )


def require_stiff(scenario: Scenario, mode: Mode) -> None:
    """Raise ScenarioError where a force is to be controlled on springs without stiffness."""
    for each in scenario.surfaces:
        if mode.on_surface and each.pressed and each.contact.nature.springs and each.contact.K_e == 0.0:
            raise ScenarioError(
                f"{each.path}contact.K_e: 0 N/m, which takes no force in {mode.name} mode; allowed: > 0"
            )


def require_coupling(scenario: Scenario, mode: Mode) -> None:
    """Raise ScenarioError unless the matrices over coupled surfaces are what (28), (32) and (33) admit."""
    environment, k, K_e_hat = environment_of(scenario), len(scenario.surfaces), believed_matrix(scenario)
    if mode.pressed and np.count_nonzero(K_e_hat - np.diag(np.diag(K_e_hat))):
        _require_definite(scenario, "K_e_hat", K_e_hat, "definite")
    if not environment.coupled:
        return
    _require_definite(scenario, "K_e", environment.K_e[:k, :k], "definite")
    _require_definite(scenario, "B_e", environment.B_e[:k, :k], "semidefinite")
    _require_definite(scenario, "M_e", environment.M_e[:k, :k], "semidefinite")


def _require_definite(
    scenario: Scenario, name: str, matrix: np.ndarray, wanted: Literal["definite", "semidefinite"]
) -> None:
    """Raise ScenarioError unless a symmetric matrix over the surfaces is positive definite, or semidefinite."""
    eigenvalues = np.linalg.eigvalsh(matrix)
    least = ROUNDED * eigenvalues[-1] * (1.0 if wanted == "definite" else -1.0)
    if eigenvalues[0] < least or (wanted == "definite" and eigenvalues[0] <= 0.0):
        unit, given = field_info(f"coupling.{name}").unit, getattr(scenario.coupling, name)
        raise ScenarioError(
            f"coupling.{name}: {list(given)} {unit} makes {name} = {matrix.tolist()} {unit}, with the eigenvalue "
            f"{eigenvalues[0]:.4g}; allowed: entries with which it is symmetric positive {wanted}"
        )


def face_obstacle(scenario: Scenario) -> str | None:
    """Reason why a flat tool cannot touch the scenario's surfaces, None where it can."""
    number, form, contact = len(scenario.surfaces), scenario.surface, scenario.contact
    if number > 1:
        return f"on {number} surfaces; allowed: on one"
    if not form.planar:
        return f"on a surface of kind {kind_of(form)!r}; allowed: on a plane"
    if contact.nature.heavy:
        light = ", ".join(name for name, kind in CONTACTS.items() if not kind.heavy)
        return f"with contact.kind {contact.kind!r}; allowed: {light}"
    return None


def require_face(scenario: Scenario, mode: Mode, robot: robots.Robot) -> None:
    """Raise WrongFace where the tool cannot be flat."""
    if not scenario.face.flat:
        return
    _, angles = task_joints(scenario, robot)
    what = face_obstacle(scenario)
    if what is None and robot.geometry == "planar":
        what = "with an arm in a plane; allowed: in space"
    if what is None and mode.on_surface and angles != 3:
        what = "without the tool's angles among the coordinates; allowed: with all three"
    if what is not None:
        raise WrongFace(f"face.flat: true {what}")


def require_pushing(scenario: Scenario, mode: Mode) -> None:
    """Raise PullingForce where a desired force is negative at times and its surface only pushes.

    With a rigid surface this is not checked here: the run stops when contact is lost.
    """
    for each in scenario.surfaces[: mode.pressed]:
        contact, pulling = each.contact, each.force.pulling()
        if pulling and contact.unilateral and not contact.nature.rigid:
            what, allowed = pulling
            raise PullingForce(
                f"{each.path}{what}, but the surface only pushes ({each.path}contact.unilateral); allowed: {allowed}, "
                f"or {each.path}contact.unilateral = false",
                each.path,
            )


def require_reachable_moment(scenario: Scenario, mode: Mode) -> None:
    """Raise ScenarioError where moments are desired that a flat face has only with a part of its springs lifted.

    All of them press while phi > a |theta|, a the face's radius; with phi = f_n / K_e, theta = m / K_t and
    K_t = a^2 K_e / 2 that is |m| < f_n a / 2.
    """
    contact, size = scenario.contact, float(np.linalg.norm(scenario.face.moment))
    if not scenario.face.flat or not mode.pressed or not contact.unilateral or not size:
        return
    force, radius = scenario.force.least, face_radius(scenario.face.K_t, max(contact.K_e, SOFTEST))
    largest = 0.5 * force * radius
    if size >= largest:
        raise ScenarioError(
            f"face.moment: {list(scenario.face.moment)} N·m, of size {size:.4g} N·m, lifts a side of the face where "
            f"the desired force is {force:g} N; allowed: a size below {largest:.4g} N·m, half of that force times the "
            f"face's radius of {radius:.3g} m, or contact.unilateral = false"
        )


def require_sampled(scenario: Scenario) -> None:
    """Raise ScenarioError for what is too fast or too short for the control period."""
    _require_sampled_delays(scenario)
    _require_sampled_paths(scenario)
    _require_sampled_frequencies(scenario)


def _require_sampled_delays(scenario: Scenario) -> None:
    """Raise ScenarioError for a delay of the force sensor that would be none: it takes a whole number of control
    periods, the nearest one."""
    period = scenario.controller.period
    for name in ("delay", "moment_delay"):
        delay = getattr(scenario.sensor, name)
        if delay > 0.0 and round(delay / period) == 0:
            raise ScenarioError(
                f"sensor.{name}: {delay:g} s, less than half of controller.period = {period:g} s, of which it takes a "
                f"whole number; allowed: 0, more than {0.5 * period:g} s, or a shorter controller.period"
            )


def _require_sampled_paths(scenario: Scenario) -> None:
    """Raise ScenarioError for a path that is over and over again at its start within two control periods: the loop sees
    a slower one."""
    shortest = 2.0 * scenario.controller.period
    for section in ("motion", "rotation"):
        period = getattr(getattr(scenario, section), "period", None)
        if period is not None and period <= shortest:
            raise ScenarioError(
                f"{section}.period: {period:g} s, at most two control periods, so that the loop sees a slower path; "
                f"allowed: above {shortest:g} s, or a shorter controller.period"
            )


def _require_sampled_frequencies(scenario: Scenario) -> None:
    """Raise ScenarioError for a desired force, or a surface that moves or tilts, at half the control rate or faster:
    the loop sees a slower one; and for a disturbance at half the rate of the plant's steps or faster."""
    half = 0.5 / scenario.controller.period
    for each in scenario.surfaces:
        sections = {"surface.motion": each.form.motion, "surface.tilt": getattr(each.form, "tilt", None)}
        for name, section in (sections | {"force": each.force}).items():
            swings = getattr(section, "amplitude", 0.0) > 0.0
            if swings and (frequency := getattr(section, "frequency", 0.0)) >= half:
                raise ScenarioError(
                    f"{each.path}{name}.frequency: {frequency:g} Hz, at least half the control rate, so that the loop "
                    f"sees a slower one; allowed: below {half:g} Hz, or a shorter controller.period"
                )
    truth, finest = scenario.truth, half * scenario.simulation.substeps
    if truth.disturbance > 0.0 and truth.disturbance_frequency >= finest:
        raise ScenarioError(
            f"truth.disturbance_frequency: {truth.disturbance_frequency:g} Hz, at least half the rate of the plant's "
            f"steps, so that the arm feels a slower one; allowed: below {finest:g} Hz, or more simulation.substeps"
        )


def require_kinds(scenario: Scenario, mode: Mode) -> None:
    """Raise ScenarioError for a kind of contact or of task space that the mode does not have."""
    if scenario.contact.kind not in admitted_contacts(mode):
        allowed = ", ".join(admitted_contacts(mode))
        raise ScenarioError(f"contact.kind: {scenario.contact.kind!r} in {mode.name} mode; allowed: {allowed}")
    if scenario.task_space.kind == "joint" and not mode.in_joints:
        raise ForceInJoints(
            f"task_space.kind: 'joint' in {mode.name} mode; allowed: 'cartesian' ("
            f"joint in {' or '.join(IN_JOINTS)} mode)"
        )
