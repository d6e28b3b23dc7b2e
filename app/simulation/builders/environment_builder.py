"""Environment of a scenario: arm, true arm, surface, and the desired motion and force of the tool."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pinocchio as pin

from app.scenario.data import kind_of
from app.scenario.declared_bounds import link_rows, symmetric
from app.scenario.errors import IrregularCorner, ScenarioError, WrongFace, scenario_errors
from app.scenario.own_code import own_course, own_shape
from app.scenario.schema import Scenario
from controllers.modes import Mode
from controllers.nominal_model import NominalModel
from controllers.task_space import TaskLayout
from environments import robots
from environments.contact import Contact, Face, face_radius
from environments.coupled_surfaces import EnvironmentMatrices
from environments.force_profiles.force_profile import ForceCourse
from environments.force_profiles.step import ConstantForce
from environments.force_profiles.table import course_of as force_course
from environments.push import TimedPush
from environments.surfaces import own as own_surfaces
from environments.surfaces.corner import Corner
from environments.surfaces.form import Form, tangent_frame, unit
from environments.surfaces.table import Surface
from environments.trajectories import own as own_trajectories
from environments.trajectories.table import course_of, numbered
from environments.trajectories.trajectory import Course, spread
from environments.truth import Truth
from parameters import Matrix

SOFTEST = 1e-3  # N/m: of a surface without stiffness a face has no size
FACING = 0.8  # least cosine between the face's normal and the surface's at the start
UNLIMITED = 1e6  # N m: an effort limit of a URDF beyond this means that there is none


def robot_of(scenario: Scenario) -> robots.Robot:
    """The arm of the controller's model. Raises RobotError."""
    r = scenario.robot
    return robots.load(
        r.name,
        urdf=r.urdf,
        tool_frame=r.tool_frame,
        tool_offset=r.tool_offset,
        posture=r.posture,
        rotor_inertia=r.rotor_inertia,
    )


def truth_of(scenario: Scenario, robot: robots.Robot) -> Truth:
    """Differences of the true arm from the nominal one. Raises ScenarioError."""
    t, n = scenario.truth, robot.n
    return Truth(
        link_scaling=_factors("truth.link_scaling", t.link_scaling, n, "link"),
        payload_mass=t.payload_mass,
        payload_offset=np.array(t.payload_offset),
        coulomb=t.coulomb,
        viscous=t.viscous,
        disturbance=t.disturbance,
        disturbance_frequency=t.disturbance_frequency,
        torque_limit=_torque_limit(t.torque_limit, robot),
        rotor_scaling=_factors("truth.rotor_scaling", t.rotor_scaling, n, "joint"),
        link_centre=_link_rows("truth.link_centre", t.link_centre, n, 3),
        link_shape=_shapes("truth.link_shape", t.link_shape, n),
    )


def _link_rows(path: str, given: Matrix, n: int, width: int) -> np.ndarray:
    """Rows (n, width), given as one for all links or one each. Raises ScenarioError."""
    rows = link_rows(given)
    if rows is None or rows.shape[1] != width or len(rows) not in (1, n):
        raise ScenarioError(f"{path}: {given!r:.80}; allowed: {width} numbers, or {n} rows of {width}, one per link")
    return np.broadcast_to(rows, (n, width))


def _shapes(path: str, given: Matrix, n: int) -> np.ndarray:
    """Relative changes (n, 3, 3) of the links' inertias. Raises ScenarioError."""
    Z = symmetric(_link_rows(path, given, n, 6))
    least = float(np.linalg.eigvalsh(Z).min())
    if not least > -1.0:
        raise ScenarioError(f"{path}: a link with {1.0 + least:.3g} of its inertia about an axis; allowed: more than 0")
    return Z


def _factors(path: str, given: float | tuple[float, ...], n: int, of: str) -> np.ndarray:
    """Factors (n,), given as one number or one each. Raises ScenarioError."""
    if np.ndim(given) == 1 and np.shape(given) != (n,):
        raise ScenarioError(f"{path}: {np.size(given)} values; allowed: one number or {n}, one per {of}")
    factors = np.broadcast_to(np.array(given, dtype=float), (n,))
    if (factors <= 0.0).any():
        raise ScenarioError(f"{path}: {float(factors.min())}; allowed: numbers > 0")
    return factors


def push_of(scenario: Scenario) -> TimedPush:
    """The push at fixed times. Raises ScenarioError."""
    t = scenario.truth
    if t.push_sweep_to > 0.0 and t.push_frequency == 0.0:
        raise ScenarioError(
            f"truth.push_sweep_to: {t.push_sweep_to:g} Hz without a frequency to begin with; allowed: 0, or with a "
            "truth.push_frequency above 0"
        )
    acts = any(t.push) or any(t.push_moment)
    if acts and 0.0 < t.push_every < t.push_duration and t.push_frequency > 0.0:  # a constant push just goes on
        raise ScenarioError(
            f"truth.push_every: {t.push_every:g} s, which cuts a sine of {t.push_duration:g} s short; allowed: 0 for "
            "once, or at least truth.push_duration"
        )
    fastest, half = max(t.push_frequency, t.push_sweep_to), 0.5 / scenario.controller.period
    if acts and fastest >= half:
        field = "push_frequency" if t.push_frequency >= half else "push_sweep_to"
        raise ScenarioError(
            f"truth.{field}: {fastest:g} Hz, at least half the control rate, so that the loop sees a slower one; "
            f"allowed: below {half:g} Hz, or a shorter controller.period"
        )
    times = t.push_start, t.push_duration, t.push_every, t.push_frequency
    return TimedPush(np.array(t.push), *times, np.array(t.push_moment), t.push_sweep_to)


def _torque_limit(given: float | tuple[float, ...], robot: robots.Robot) -> np.ndarray:
    """Torque limits of the drives, (n,) N m; infinite where there are none."""
    path, n, numbers = "truth.torque_limit", robot.n, np.atleast_1d(np.array(given, dtype=float))
    if np.ndim(given) == 0 and numbers[0] == 0.0:
        return np.full(n, np.inf)
    if (numbers <= 0.0).any():
        raise ScenarioError(f"{path}: {float(numbers.min())}; allowed: 0 for no limit, or numbers > 0")
    if np.ndim(given) == 1:
        if len(numbers) != n:
            raise ScenarioError(f"{path}: {len(numbers)} values; allowed: one factor, or {n} torques, one per joint")
        return numbers
    for name, effort in zip(robot.joint_names, robot.model.effortLimit, strict=True):
        if not 0.0 < effort < UNLIMITED:
            raise ScenarioError(
                f"{path}: {given:g}, but the URDF gives no effort limit for joint {name!r}; "
                f"allowed: 0 for no limit, or {n} torques, one per joint"
            )
    return numbers[0] * robot.model.effortLimit


def tool_at_start(robot: robots.Robot, nominal: NominalModel) -> np.ndarray:
    """Place of the tool in the robot's own posture, (3,) m."""
    return nominal.evaluate(robot.posture, np.zeros(robot.n)).p


def surfaces_of(scenario: Scenario, near: np.ndarray) -> tuple[Surface, ...]:
    """Surfaces of the scenario, see `surface`. Raises ScenarioError."""
    found = []
    for each in scenario.surfaces:
        try:
            found.append(surface(each.form, near))
        except ScenarioError as error:
            raise ScenarioError(f"{each.path}{error}") from error
    return tuple(found)


def surface(form: Form, near: np.ndarray) -> Surface:
    """Surface of a form. near: (3,) m, place of the tool, which selects the part of a typed surface. Raises
    ScenarioError."""
    with scenario_errors():
        shape = own_shape(form) if isinstance(form, own_surfaces.OwnForm) else None
        return Surface.of(form, near, shape)


def contacts_of(scenario: Scenario) -> tuple[Contact, ...]:
    """Contact with each surface, where an elastic one may stand beside a massive one."""
    contacts = []
    for each in scenario.surfaces:
        given = Contact(*(getattr(each.contact, name) for name in Contact._fields))
        contacts.append(given if each.contact.nature.massive else given._replace(M_e=0.0))
    return tuple(contacts)


def beside_diagonal(scenario: Scenario, name: str) -> np.ndarray:
    """Entries (k, k) of a matrix of `coupling` over the k surfaces of the scenario, with zeros on its diagonal; all
    zero for a mass where the surfaces have none, and for every matrix of rigid surfaces."""
    natures = [each.contact.nature for each in scenario.surfaces]
    has = np.array([nature.massive if name == "M_e" else nature.springs for nature in natures], dtype=float)
    whole, there = np.zeros((3, 3)), [each.index for each in scenario.surfaces]
    for pair, entry in zip(combinations(range(3), 2), getattr(scenario.coupling, name), strict=True):
        whole[pair] = whole[pair[::-1]] = entry
    return whole[np.ix_(there, there)] * np.outer(has, has)


def environment_of(scenario: Scenario) -> EnvironmentMatrices:
    """Matrices of (28) over all surfaces."""
    contacts = contacts_of(scenario)
    return EnvironmentMatrices.of(
        **{
            name: np.diag([getattr(contact, name) for contact in contacts]) + beside_diagonal(scenario, name)
            for name in ("M_e", "B_e", "K_e")
        }
    )


def believed_matrix(scenario: Scenario) -> np.ndarray:
    """Estimated stiffness (k, k) N/m of all k surfaces, K_e_hat in (33)."""
    return np.diag([each.K_e_hat for each in scenario.surfaces]) + beside_diagonal(scenario, "K_e_hat")


def task_surface(scenario: Scenario, surfaces: tuple[Surface, ...], near: np.ndarray) -> Surface | Corner:
    """The surfaces of the scenario as they give the task coordinates of a tool near the point `near` (3,) m. Raises
    IrregularCorner, which names the first surface that makes no corner with those before it."""
    charted: Surface | Corner = surfaces[0]
    for number in range(1, len(surfaces)):
        try:
            charted = Corner(surfaces[: number + 1], near)
        except ValueError as error:
            added = scenario.surfaces[number]
            field = "surface.normal" if added.form.planar else "surface"
            raise IrregularCorner(f"{added.path}{field}: {error}") from error
    return charted


def task_axes(scenario: Scenario, robot: robots.Robot) -> np.ndarray:
    """Cartesian axes in the order of their coordinates, as rows in the world; a planar arm uses the first two, x and z.
    Raises ScenarioError."""
    turn = scenario.task_space.axes
    if max(map(abs, turn)) > 2 * np.pi:
        raise ScenarioError(f"task_space.axes: {list(turn)} rad; allowed: from -6.28 to 6.28")
    if robot.geometry == "planar" and (turn[0] or turn[2]):
        raise ScenarioError(f"task_space.axes: {list(turn)} rad; allowed for a planar arm: 0, a number, 0")
    axes = pin.exp3(np.asarray(turn)).T
    return axes[[0, 2, 1]] if robot.geometry == "planar" else axes


def task_joints(scenario: Scenario, robot: robots.Robot) -> tuple[tuple[int, ...], int]:
    """Supplemental joints, counted from 0, and the number of the tool's angles that complete r with them. Raises
    ScenarioError."""
    given, path = scenario.task_space.supplemental, "task_space.supplemental"
    n, rest = robot.n, robot.n - positions_of(robot)
    if given is None:
        return robot.supplemental, rest - len(robot.supplemental)
    if len(set(given)) < len(given) or not all(1 <= joint <= n for joint in given):
        raise ScenarioError(f"{path}: {list(given)}; allowed: different numbers from 1 to {n}")
    counts = sorted({len(robot.supplemental), rest})
    if len(given) not in counts:
        allowed = " or ".join(map(str, counts))
        raise ScenarioError(f"{path}: {len(given)} joints; allowed: {allowed} with this arm")
    return tuple(joint - 1 for joint in given), rest - len(given)


def positions_of(robot: robots.Robot) -> int:
    """Number of a Cartesian task's coordinates that are positions."""
    return 2 if robot.geometry == "planar" else 3


def _free(mode: Mode, layout: TaskLayout) -> range:
    """Coordinates that a trajectory may move."""
    return range(mode.force_directions, layout.n if layout.joint else layout.end_of_positions)


def spread_over(path: str, displacement: tuple[float, ...], mode: Mode, layout: TaskLayout) -> np.ndarray:
    """Displacement of all n coordinates from one of the free coordinates. Raises ScenarioError with `path` for one with
    too many values."""
    free = _free(mode, layout)
    with scenario_errors():  # the default is one zero, also where no coordinate is free
        return spread(path, displacement if len(free) or any(displacement) else (), layout.n, free)


def motion_of(scenario: Scenario, mode: Mode, layout: TaskLayout) -> Course:
    """Desired motion of the free coordinates, (n,), from the start. Raises ScenarioError."""
    path, free = scenario.motion, _free(mode, layout)
    with scenario_errors():
        if isinstance(path, own_trajectories.OwnPath):
            return numbered(path, own_course(path, layout.n, free))
        return course_of("motion", path, layout.n, free)


def rotation_of(scenario: Scenario, layout: TaskLayout) -> Course:
    """Desired motion of the tool's angles and of supplemental joints, (n,), from the start.
    Raises ScenarioError."""
    path, n = scenario.rotation, layout.n
    if layout.joint and path.moves:
        raise ScenarioError(
            f"rotation.kind: {kind_of(path)!r}; allowed where r = q: 'hold', since motion moves the joints"
        )
    with scenario_errors():
        course = course_of("rotation", path, n, range(layout.end_of_positions, n))
    return course._replace(u=layout.lengths * course.u, v=layout.lengths * course.v)


def forces_of(scenario: Scenario) -> tuple[ForceCourse, ...]:
    """Course of the desired normal force on each surface, N, and after them of the moments of a flat tool over l."""
    forces = tuple(force_course(each.force) for each in scenario.surfaces)
    if not scenario.face.flat:
        return forces
    l = scenario.task_space.characteristic_length
    return *forces, *(force_course(ConstantForce(moment / l)) for moment in scenario.face.moment)


def face_axes(scenario: Scenario) -> np.ndarray:
    """Two orthogonal unit axes (2, 3) of the tool's face, in the tool's frame. Raises ScenarioError."""
    with scenario_errors():
        return tangent_frame(unit("face.normal", scenario.face.normal))[1:]


def face_of(scenario: Scenario, robot: robots.Robot) -> Face:
    """The tool's face. Raises ScenarioError."""
    if not scenario.face.flat:
        return Face.point()
    radius = face_radius(scenario.face.K_t, max(scenario.contact.K_e, SOFTEST))
    return Face.of(face_axes(scenario) @ robot.tool_placement.rotation.T, radius)


def level_of(scenario: Scenario, R: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Directions (2, 3) in the world along the plane with this unit normal (3,): of the face's first axis, and across.
    R: (3, 3), of the tool at the start. Raises WrongFace where the face does not look at the plane."""
    first, second = face_axes(scenario) @ R.T
    facing = float(np.cross(first, second) @ normal)
    if facing < FACING:
        raise WrongFace(
            f"face.normal: {list(scenario.face.normal)}, {np.arccos(np.clip(facing, -1.0, 1.0)):.3g} rad off the "
            f"surface's normal at the start; allowed: up to {np.arccos(FACING):.2g} rad"
        )
    along = first - (first @ normal) * normal
    along = along / np.linalg.norm(along)
    return np.stack([along, np.cross(normal, along)])
