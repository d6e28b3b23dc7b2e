"""Desired force that is constant, or that changes once."""

from __future__ import annotations

from typing import Annotated

from environments.force_profiles.force_profile import ForceCourse, ForceProfile, negative
from environments.smooth_step import minimum_jerk
from kernels import inline
from parameters import decades, field, slider


@inline
def _at(course, t):
    sigma, sigma_dot, sigma_ddot = minimum_jerk(t - course.time, course.rise)
    return course.start + course.change * sigma, course.change * sigma_dot, course.change * sigma_ddot


class ConstantForce(ForceProfile, frozen=True, forbid_unknown_fields=True, tag="constant"):
    """A constant desired normal force."""

    title = "constant"
    at = _at

    @property
    def course(self) -> ForceCourse:
        return ForceCourse(0, float(self.value), 0.0, 0.0, 0.1, 0.0)


class ForceStep(ForceProfile, frozen=True, forbid_unknown_fields=True, tag="step"):
    """A step of the desired normal force, smooth within `rise` so that it has two derivatives."""

    title = "step"
    at = _at

    start: Annotated[
        float,
        field(
            "force before it",
            "N",
            slider("before", 0, 60),
            ge=-1e4,
            le=1e4,
            title="force before the change (desired force)",
        ),
    ] = 10.0
    time: Annotated[
        float, field("when", "s", slider("at time", 0, 20), ge=0, le=3600, title="time of the change (desired force)")
    ] = 2.0
    rise: Annotated[
        float,
        field(
            "how long it takes",
            "s",
            decades("rise", 0.01, 2),
            gt=0,
            le=3600,
            title="duration of the change (desired force)",
        ),
    ] = 0.2

    @property
    def course(self) -> ForceCourse:
        start, value, time, rise = (float(x) for x in (self.start, self.value, self.time, self.rise))
        return ForceCourse(0, start, value - start, time, rise, 0.0)

    @property
    def least(self) -> float:
        return min(self.start, self.value)

    def pulling(self) -> tuple[str, str] | None:
        return negative("value", self.value) or negative("start", self.start)
