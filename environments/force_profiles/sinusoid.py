"""Sinusoidal desired force about a mean."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from environments.force_profiles.force_profile import ForceCourse, ForceProfile, negative
from kernels import inline
from parameters import decades, field, slider


@inline
def _at(course, t):
    omega = course.omega
    s, c = course.change * np.sin(omega * t), course.change * np.cos(omega * t)
    return course.start + s, omega * c, -(omega**2) * s


class ForceSinusoid(ForceProfile, frozen=True, forbid_unknown_fields=True, tag="sinusoid"):
    """A sinusoidal desired normal force, value + amplitude sin(2 pi frequency t)."""

    title = "sinusoid"
    at = _at

    amplitude: Annotated[float, field("amplitude", "N", slider("amplitude", 0, 20), ge=0, le=1e4)] = 5.0
    frequency: Annotated[float, field("frequency", "Hz", decades("frequency", 0.05, 5), ge=0, le=50)] = 0.5

    @property
    def course(self) -> ForceCourse:
        return ForceCourse(0, float(self.value), float(self.amplitude), 0.0, 0.0, 2 * np.pi * self.frequency)

    @property
    def least(self) -> float:
        return self.value - self.amplitude

    def pulling(self) -> tuple[str, str] | None:
        if self.amplitude > self.value >= 0.0:
            return f"force.amplitude: {self.amplitude:g} N around {self.value:g} N", "at most the mean"
        return negative("value", self.value)
