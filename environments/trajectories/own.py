"""Trajectory of a user's own, in a file that `--use` names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import msgspec
import numpy as np

from environments.own_function import OwnFunction, call, own_function, written_beyond
from environments.trajectories.trajectory import Course, Trajectory, in_plane
from kernels import inline
from parameters import Name, Parameter, field, values_of

INSTANTS = (0.0, 0.1, 1.7, 9.3)  # s, at which a path is tried


@dataclass(frozen=True)
class OwnTrajectory:
    """Trajectory of a user's own, as its file describes it under the name TRAJECTORY.

    kind: its name in a scenario (`motion.name`); title: its name on the page; about: a sentence for the page.
    path: `path(t, parameters, value, rate, acceleration)` writes the displacement (k,) m of the k free coordinates from
    their start, its rate and its acceleration at time t (s); they are zero before. It is decorated with
    `kernels.inline` or `kernels.allocating`. At t = 0 the displacement is zero. k is value.shape[0], and depends on
    mode and arm.
    """

    kind: str
    title: str
    about: str
    path: Callable[..., None]
    parameters: tuple[Parameter, ...] = ()

    def course(self, path: OwnPath, n: int, free: range) -> Course:
        """Course with the parameters of a scenario, as a displacement of n coordinates. Raises ValueError with one
        sentence, OwnFunctionError, and numba's errors."""
        values = values_of(self.parameters, path.parameters, "motion.parameters")
        k = (len(free),)
        own = own_function(self.path, self.path, values, (k, k, k))
        _require_within(self.kind, own, len(free))
        return in_plane(np.zeros(n), np.zeros(n))._replace(first=free.start, own=own)


def _require_within(kind: str, own: OwnFunction, k: int) -> None:
    """Raise ValueError where the path writes beyond its k coordinates, and OwnFunctionError where it fails."""
    where = "tried at t = {:g} s with value.shape[0] = {}"
    places = [place for t in INSTANTS for place in written_beyond(own, t, (k, k, k), where.format(t, k))]
    beyond = [place for place in places if place is not None]
    if beyond:
        raise ValueError(
            f"motion.name: {kind!r} writes coordinate {k + 1 + min(beyond)}; allowed: 1 to {k} (value.shape[0]), the "
            "free ones of this mode and arm"
        )


@inline
def _move(course, t, value, rate, acceleration):
    own, first = course.own, course.first
    call(own.address, t, own.parameters, value[first:], rate[first:], acceleration[first:])


class OwnPath(Trajectory, frozen=True, forbid_unknown_fields=True, tag="own"):
    """A path of your own (`--use`)."""

    title = "own"
    move = _move
    suits_angles = False

    name: Annotated[Name, field("kind of the trajectory in your file", "")] = ""
    parameters: Annotated[dict[Name, float], field("its parameters, by name", "")] = msgspec.field(default_factory=dict)
