"""Planned reference of a run: r_d and F_cd as functions of time, with the r_fd that desired forces ask for (33)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controllers.control_law import Reference
from controllers.followed_faces import FollowedFaces, set_pressed
from environments.force_profiles.force_profile import ForceCourse
from environments.force_profiles.table import force_at
from environments.shift import SmoothShift, add_shift
from environments.surfaces.chart import one_of
from environments.trajectories.point_to_point import Hold
from environments.trajectories.table import add_path, course_of, path_at
from environments.trajectories.trajectory import Course
from kernels import inline, kernel
from kernels.records import Record


class Forces(NamedTuple):
    """Courses of the desired normal force on up to three surfaces."""

    first: ForceCourse
    second: ForceCourse
    third: ForceCourse

    @classmethod
    def of(cls, courses: tuple[ForceCourse, ...]) -> Forces:
        """Courses on one, two or three surfaces."""
        return cls._make((*courses, *courses[-1:], *courses[-1:])[:3])

    def constant(self, f: np.ndarray) -> Forces:
        """Forces f (3,) N from now on."""
        return Forces._make(each._replace(start=value, change=0.0) for each, value in zip(self, f, strict=True))


class ReferencePlan(NamedTuple):
    """Plan of the reference.
    start: (n,), r at t = 0, to which motion and shift add.
    compliance: (3, 3) m/N, r_fd per f_nd on the surfaces, K_e_hat^-1 in (33), 0 on rigid surfaces (41).
    followed: the faces of the same body that the tool follows at a distance.
    m: number of force-controlled directions."""

    start: np.ndarray
    compliance: np.ndarray
    followed: FollowedFaces
    m: int
    motion: Course
    rotation: Course
    shift: SmoothShift
    forces: Forces

    def at_rest(self, r: np.ndarray, f: np.ndarray) -> ReferencePlan:
        """Plan of staying at r (n,) with the present forces f (3,) N."""
        still = course_of("motion", Hold(), len(r), range(0))
        here, forces = SmoothShift.fresh(np.zeros_like(r), 1.0), self.forces.constant(f)
        return self.stiff()._replace(start=r, motion=still, rotation=still, shift=here, forces=forces)

    def stiff(self) -> ReferencePlan:
        """Plan without the r_fd that forces ask for."""
        return self._replace(compliance=np.zeros((3, 3)), followed=FollowedFaces.none())


@inline
def reference_at(plan, t, reference):
    """Compute the `Reference` at t (s): r_d = start + motion + rotation + shift; in the first m coordinates r_d is
    r_fd = K_e_hat^-1 f_nd (33), with what followed faces of the same body add, and F_cd = f_nd."""
    path_at(plan.motion, t, reference.r_d, reference.r_d_dot, reference.r_d_ddot)
    add_path(plan.rotation, t, reference.r_d, reference.r_d_dot, reference.r_d_ddot)
    add_shift(plan.shift, t, reference.r_d, reference.r_d_dot, reference.r_d_ddot)
    for i in range(reference.r_d.shape[0]):
        reference.r_d[i] += plan.start[i]
        reference.F_cd[i] = 0.0
    for i in range(plan.m):
        reference.r_d[i] = reference.r_d_dot[i] = reference.r_d_ddot[i] = 0.0
    for i in range(plan.m):
        f, f_dot, f_ddot = force_at(one_of(plan.forces, i), t)
        for j in range(plan.m):
            reference.r_d[j] += plan.compliance[j, i] * f
            reference.r_d_dot[j] += plan.compliance[j, i] * f_dot
            reference.r_d_ddot[j] += plan.compliance[j, i] * f_ddot
        reference.F_cd[i] = f
    if plan.followed.sets > 0:
        _add_followed(plan, t, reference)


@inline
def _add_followed(plan, t, reference):
    """Add to r_fd what the faces ask for that the tool follows at r_pd."""
    faces, r_d = plan.followed, reference.r_d
    f_2 = reference.F_cd[1] if plan.m > 1 else r_d[1]
    last = 0.0 if faces.surfaces < 3 else r_d[2]
    pressed = set_pressed(faces, (reference.F_cd[0], f_2, last))
    if pressed == faces.sets:
        return
    for i in range(faces.surfaces):
        if i < plan.m:
            w, w_dot, w_ddot = force_at(one_of(plan.forces, i), t)
        else:
            w, w_dot, w_ddot = r_d[i], reference.r_d_dot[i], reference.r_d_ddot[i]
        for j in range(plan.m):
            r_d[j] += faces.added[pressed, j, i] * w
            reference.r_d_dot[j] += faces.added[pressed, j, i] * w_dot
            reference.r_d_ddot[j] += faces.added[pressed, j, i] * w_ddot


@kernel
def _reference_alone(plan, t, reference):
    reference_at(plan[0], t, reference[0])


class Planned:
    """Planned reference: `reference_at` for use outside kernels."""

    def __init__(self, plan: ReferencePlan) -> None:
        self._plan = Record(plan)
        self._blank = Record.zeros(Reference, len(plan.start))

    def at(self, t: float) -> Reference:
        """r_d and F_cd with their derivatives at time t (s)."""
        reference = self._blank.copy()
        _reference_alone(self._plan.data, t, reference.data)
        return reference.read()
