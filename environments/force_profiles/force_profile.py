"""Base class of all desired forces: fields of a scenario, and their compiled function."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, NamedTuple

from parameters import Section, field, slider


class ForceSignal(NamedTuple):
    """Desired force at one instant (N), its rate and second derivative."""

    value: float
    rate: float
    acceleration: float


class ForceCourse(NamedTuple):
    """Desired force over time for kernels.
    kind: number of the profile.
    start, change: N.
    time, rise: of a step, s.
    omega: angular frequency of a harmonic, rad/s."""

    kind: int
    start: float
    change: float
    time: float
    rise: float
    omega: float


class ForceProfile(Section, frozen=True, forbid_unknown_fields=True, tag_field="kind"):
    """Base class of all desired forces: section `force` of a scenario.

    title: name on the page; at: its kernel `at(course, t)`, the force (N) and its two derivatives at time t (s).
    """

    title: ClassVar[str]
    at: ClassVar[Any]

    value: Annotated[
        float,
        field(
            "desired force: its mean, or that after a step",
            "N",
            slider("F_d", 0, 60),
            ge=-1e4,
            le=1e4,
            title="desired force",
        ),
    ] = 20.0

    @property
    def course(self) -> ForceCourse:
        """The profile for kernels; the table sets `kind`."""
        raise NotImplementedError

    @property
    def least(self) -> float:
        """Least force at any time, N."""
        return self.value

    def pulling(self) -> tuple[str, str] | None:
        """The field, with its value, that makes the force negative at times, and the allowed values; None where it
        never is."""
        return negative("value", self.value)


def negative(name: str, force: float) -> tuple[str, str] | None:
    """Result of `pulling` for a force (N) in a field."""
    return (f"force.{name}: {force:g} N", "at least 0 N") if force < 0.0 else None
