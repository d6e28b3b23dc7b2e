"""Table of desired forces, by their names in a scenario, and one kernel for all."""

from __future__ import annotations

from typing import TYPE_CHECKING, Union

from environments.force_profiles.force_profile import ForceCourse, ForceProfile, ForceSignal
from environments.force_profiles.sinusoid import ForceSinusoid
from environments.force_profiles.step import ConstantForce, ForceStep
from kernels import choice, inline, kernel
from kernels.records import Record

FORCE_PROFILES: tuple[type[ForceProfile], ...] = (ConstantForce, ForceStep, ForceSinusoid)
if TYPE_CHECKING:
    AnyForceProfile = ForceProfile
else:
    AnyForceProfile = Union[FORCE_PROFILES]  # noqa: UP007

_at = choice([each.at for each in FORCE_PROFILES])


def course_of(profile: ForceProfile) -> ForceCourse:
    """Desired force (N) in the form for kernels."""
    return profile.course._replace(kind=FORCE_PROFILES.index(type(profile)))


@inline
def force_at(course, t):
    """Force (N) and its derivatives at time t (s)."""
    return _at(course.kind, course, t)


@kernel
def _force_alone(course, t):
    return force_at(course[0], t)


def evaluated(course: ForceCourse, t: float) -> ForceSignal:
    """Force at time t (s)."""
    return ForceSignal(*_force_alone(Record(course).data, t))
