"""All desired forces: what a scenario may name, and the one kernel that they make together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Union

from environments.force_profiles.force_profile import ForceCourse, ForceProfile, Signal
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
    """The desired force (N) in the kernels' form."""
    return profile.course._replace(kind=FORCE_PROFILES.index(type(profile)))


@inline
def force_at(course, t):
    """The force (N) and its derivatives at time t (s)."""
    return _at(course.kind, course, t)


@kernel
def _force_alone(course, t):
    return force_at(course[0], t)


def evaluated(course: ForceCourse, t: float) -> Signal:
    """The force at time t (s)."""
    return Signal(*_force_alone(Record(course).data, t))
