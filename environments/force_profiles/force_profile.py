"""What every desired force is: the fields of a scenario, and the compiled function that they stand for."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, NamedTuple

from parameters import Section, field, slider


class Signal(NamedTuple):
    """A scalar (N), its rate and second derivative."""

    value: float
    rate: float
    acceleration: float


class ForceCourse(NamedTuple):
    """A force profile in the kernels' form: which one; start N and change N; the time of a step and its rise, s; the
    angular frequency of a harmonic, rad/s."""

    kind: int
    start: float
    change: float
    time: float
    rise: float
    omega: float


class ForceProfile(Section, frozen=True, forbid_unknown_fields=True, tag_field="kind"):
    """A section `force` of a scenario.

    title: how the page calls it; at: its kernel `at(course, t)`, the force (N) and its two derivatives at time t (s).
    """

    title: ClassVar[str]
    at: ClassVar[Any]

    value: Annotated[
        float,
        field("desired force: its mean, or that after a step", "N", slider("F_d", 0, 60), ge=-1e4, le=1e4),
    ] = 20.0

    @property
    def course(self) -> ForceCourse:
        """The profile; `kind` is the table's to say."""
        raise NotImplementedError

    def pulling(self) -> tuple[str, str] | None:
        """Where the force is below zero at times: the field with its value, and what is allowed; None: nowhere."""
        return negative("value", self.value)


def negative(name: str, force: float) -> tuple[str, str] | None:
    """What `pulling` says of a force (N) in a field."""
    return (f"force.{name}: {force:g} N", "at least 0 N") if force < 0.0 else None
