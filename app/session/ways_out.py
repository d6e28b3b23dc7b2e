"""Ways out of refusals: what a user can ask for instead of a scenario or a value that was refused."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

from app.scenario.data import OWN_PARAMETERS, edited, found_at
from app.scenario.errors import (
    ForceInJoints,
    IrregularCorner,
    IrregularSurface,
    PathOutOfReach,
    PullingForce,
    ScenarioError,
    SurfaceOutOfReach,
    TooStiff,
    UnboundedGain,
    WrongFace,
)
from app.scenario.field_info import field_info
from app.scenario.number_text import plain
from app.scenario.own_code import own_code
from app.scenario.schema import Scenario
from app.session.changes import adapted, in_mode, last_surface, with_face, without_last
from app.simulation.builders.controller_builder import laws, mode_of
from app.simulation.builders.environment_checks import require_stiff
from controllers.control_law import ControlLaw
from controllers.modes import IN_JOINTS
from environments.surfaces.own import OwnSurface
from environments.trajectories.own import OwnTrajectory


@dataclass(frozen=True)
class WayOut:
    """Way out of a refusal.
    title: of its button.
    scenario: to be asked for instead, see `possible`.
    fork_at: instant (s) of the run at which it can be forked.

    At most one of scenario and fork_at is given; see `asks_for_file`."""

    title: str
    scenario: Scenario | None = None
    fork_at: float | None = None

    @property
    def asks_for_file(self) -> bool:
        """Whether the page has to ask for a URDF."""
        return self.scenario is None and self.fork_at is None


def way_out(requested: Scenario, error: ScenarioError) -> WayOut | None:
    """Way out where this scenario is refused for this error; None where only the user knows one."""
    match error:
        case PathOutOfReach():
            return WayOut("Take a path that the arm can follow", requested)
        case UnboundedGain():
            return WayOut("Take a constant gain d", requested)
        case ForceInJoints():
            return WayOut(f"Go to {IN_JOINTS[0]} mode", in_mode(requested, IN_JOINTS[0]))
        case IrregularSurface():
            return WayOut("Take this surface's default form", requested)
        case IrregularCorner():
            return WayOut(f"Take the {last_surface(requested)} surface away", without_last(requested))
        case WrongFace():
            return WayOut("Touch with a point", with_face(requested, flat=False))
        case SurfaceOutOfReach():
            return WayOut("Move the surface under the tool", adapted(requested, requested))
        case PullingForce(path=str(path)):
            return WayOut("Let the surface pull, too", edited(requested, f"{path}contact.unilateral", False))
        case TooStiff(substeps=int(substeps)):
            return WayOut(f"Take {substeps} steps per period", edited(requested, "simulation.substeps", substeps))
        case _:
            return None


def nearest(scenario: Scenario, path: str, value: object) -> WayOut | None:
    """Way out where a number is out of its field's bounds: the bound; where a URDF cannot be used: another one; None
    for anything else."""
    if path == "robot.urdf":
        return WayOut("Upload a URDF")
    if not isinstance(value, float | int):
        return None
    least, largest = _bounds(scenario, path)
    for bound, word in ((least, "smallest"), (largest, "largest")):
        if bound is not None and (value < bound if word == "smallest" else value > bound):
            with suppress(ScenarioError):  # a bound that is itself not allowed is no way out
                there = edited(scenario, path, int(bound) if float(bound).is_integer() else bound)
                require_stiff(there, mode_of(there))
                return WayOut(f"Take {plain(bound)}, the {word} allowed", there)
    return None


def _bounds(scenario: Scenario, path: str) -> tuple[float | None, float | None]:
    """Least and largest number allowed at a dotted path, None where there is no bound or no such field."""
    own: Mapping[str, ControlLaw | OwnSurface | OwnTrajectory]
    with suppress(KeyError):
        match path.split("."):
            case "controller", "own", kind, name:
                own = laws()
            case [*section, "parameters", name] if path.startswith(OWN_PARAMETERS):
                own = own_code().trajectories if section == ["motion"] else own_code().surfaces
                kind = str(found_at(scenario, ".".join([*section, "name"])))
            case _:
                info = field_info(path)
                return info.least, info.largest
        parameter = {each.name: each for each in own[kind].parameters}[name]
        return parameter.low, parameter.high
    return None, None
