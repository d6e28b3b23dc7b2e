"""Errors of a scenario: one class for each reason that a caller treats in a way of its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class ScenarioError(ValueError):
    """A scenario that cannot be used: one sentence with the field's path, its value and what is allowed."""


class UnknownField(ScenarioError):
    """A scenario with a field, or an entry of a list, that it does not have."""


class WrongKind(ScenarioError):
    """A scenario with a field whose value is of another kind, as a text in place of a number."""


class UnknownChoice(ScenarioError):
    """A scenario with a word in a field, or a kind of a section, that is none of its choices."""


class PathOutOfReach(ScenarioError):
    """A scenario whose path leaves the arm's workspace."""


class UnboundedGain(ScenarioError):
    """A scenario whose gain by (17) would grow without bound."""


class SurfaceOutOfReach(ScenarioError):
    """A scenario whose surface is out of the arm's reach."""


class TooStiff(ScenarioError):
    """A scenario with a contact or friction that the plant's steps cannot follow.
    substeps: number of steps in a control period that would suffice; None where no allowed number does."""

    def __init__(self, sentence: str, substeps: int | None) -> None:
        super().__init__(sentence)
        self.substeps = substeps


class RefusedSurface(ScenarioError):
    """A scenario that is refused for one of its surfaces.
    path: beginning of the dotted paths of that surface's fields, "" for the first one."""

    def __init__(self, sentence: str, path: str) -> None:
        super().__init__(sentence)
        self.path = path


class PullingForce(RefusedSurface):
    """A scenario whose desired force pulls at a surface that only pushes."""


class ForceInJoints(ScenarioError):
    """A scenario with r = q in a mode that measures forces in space."""


class IrregularCorner(ScenarioError):
    """A scenario whose further surfaces make no corner with the others that the arm can press into."""


class WrongFace(ScenarioError):
    """A scenario with a flat tool where the tool cannot be flat."""


class IrregularSurface(RefusedSurface):
    """A scenario whose surface has no coordinates where the tool is."""


@contextmanager
def scenario_errors(kind: type[ScenarioError] = ScenarioError) -> Iterator[None]:
    """Context in which a ValueError, which has one sentence, becomes a ScenarioError of this kind."""
    try:
        yield
    except ScenarioError:
        raise
    except ValueError as error:
        raise kind(str(error)) from error
