"""Commands to a running loop: frozen, and carried out between two control periods."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from app.scenario.schema import Scenario
from app.session.timeline import Pinned
from environments.push import Grip

# fields that decide which kernels run
_WITH_KERNELS = re.compile(
    r"mode|robot\..*|task_space\.(kind|supplemental)|face\.flat|motion(\.kind)?"
    r"|((second|third)\.)?(surface(\.kind)?|contact\.kind|control)"
)


@dataclass(frozen=True)
class Play:
    """Let the run go on."""


@dataclass(frozen=True)
class Pause:
    """Hold simulated time."""


@dataclass(frozen=True)
class StepOnce:
    """Compute one control period, then hold."""


@dataclass(frozen=True)
class Reset:
    """Begin the scenario anew."""


@dataclass(frozen=True)
class Seek:
    """Hold, and look at the run as it was at t (s)."""

    t: float


@dataclass(frozen=True)
class ToEnd:
    """Look at the run at its end."""


@dataclass(frozen=True)
class Fork:
    """Go on from the instant looked at, not from the end."""


@dataclass(frozen=True)
class Pin:
    """Keep this run for comparison. may_be_pinned: a run that is pinned already is left as it is, not refused."""

    may_be_pinned: bool = False


@dataclass(frozen=True)
class Rename:
    """Call the pinned run of this number by another name, "" for none."""

    number: int
    name: str


@dataclass(frozen=True)
class Unpin:
    """Forget the pinned run of this number."""

    number: int


@dataclass(frozen=True)
class SetSpeed:
    """Set the simulated seconds per second."""

    factor: float


@dataclass(frozen=True)
class ShowAgain:
    """Show a stretch of the run, from `start` to `end` s, at another speed; from its end on at the present one."""

    start: float
    end: float
    factor: float


@dataclass(frozen=True)
class Load:
    """Load another scenario."""

    scenario: Scenario


@dataclass(frozen=True)
class BeginScenario:
    """Begin another scenario at t = 0, and let it run."""

    scenario: Scenario


@dataclass(frozen=True)
class Continue:
    """Load another scenario, with the pinned runs of the session that it was left in."""

    scenario: Scenario
    pinned: tuple[Pinned, ...]


@dataclass(frozen=True)
class Edit:
    """Change one field of the scenario by its dotted path, with plain data. Mode, fields of `robot` and kind of surface
    also change what depends on them: see `changes.in_mode`, `with_robot`, `on_surface`."""

    path: str
    value: object


@dataclass(frozen=True)
class EditAll:
    """Change several fields together, by dotted path; a number at a path's end is an entry of a list, from 1."""

    values: Mapping[str, object]


@dataclass(frozen=True)
class EditModel:
    """Change entries on the diagonals of the target model in force, or omega (rad/s) and zeta of coordinates, of which
    the one that is not given stays; M_m and every other entry stay.
    entries: new values, by the name of a matrix, "omega" or "zeta", then by coordinate from 0."""

    entries: Mapping[str, Mapping[int, float]]


FieldEdit = Edit | EditAll | EditModel


@dataclass(frozen=True)
class TimedChange:
    """A field's new value, as in `Edit`, from the instant `at` (s) of a run on."""

    at: float
    path: str
    value: object

    def due(self, t: float, period: float) -> bool:
        """Whether it is to be made before the control period (s) that begins at t (s)."""
        return t > self.at - 0.5 * period


@dataclass(frozen=True)
class Perform:
    """Begin a scenario at t = 0, make changes within a run at their instants, and pause at its end (s)."""

    scenario: Scenario
    changes: tuple[TimedChange, ...]
    end: float


@dataclass(frozen=True)
class Blend:
    """Blend to another target model within `over` s, from now on: its matrices by name, as plain data; a missing one
    stays. Refused where a model on the way is unstable."""

    model: Mapping[str, object]
    over: float


@dataclass(frozen=True)
class TakeWayOut:
    """Take the way out of the last refusal."""


@dataclass(frozen=True)
class DropWayOut:
    """Forget the way out of the last refusal, because the page shows a newer refusal."""


@dataclass(frozen=True)
class PushNow:
    """Begin the scenario's push now, in place of its schedule; where it has none, one of `changes.PUSH` N sideways. The
    next run has the scenario's own push again."""


@dataclass(frozen=True)
class DragTool:
    """Drag the tool with a hand that pushes it: take hold, move the hand, or let go (None). `Pause` and every command
    that begins a run let go, too."""

    grip: Grip | None


Command = (
    Play
    | Pause
    | StepOnce
    | Reset
    | Seek
    | ToEnd
    | Fork
    | Pin
    | Rename
    | Unpin
    | SetSpeed
    | ShowAgain
    | Load
    | BeginScenario
    | Continue
    | FieldEdit
    | Perform
    | Blend
    | PushNow
    | TakeWayOut
    | DropWayOut
    | DragTool
)


def needs_kernels(command: Command) -> bool:
    """Whether a command may bring another arm, contact, surface or tool, whose kernels may have to be compiled."""
    match command:
        case Edit(path):
            return _WITH_KERNELS.fullmatch(path) is not None
        case EditAll(values):
            return any(_WITH_KERNELS.fullmatch(path) for path in values)
        case _:
            return isinstance(command, Load | BeginScenario | Continue | Perform | TakeWayOut)
