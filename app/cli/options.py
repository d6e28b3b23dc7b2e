"""Options that several commands have, and how they are read."""

from __future__ import annotations

import math
import os
import sys
import tempfile
import tomllib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar, get_args

import msgspec
import tyro

from app.scenario.data import OWN, edited, field_of, found_at, kind_of, load, shipped, with_value
from app.scenario.errors import ScenarioError
from app.scenario.idle_fields import idle
from app.scenario.number_text import plain
from app.scenario.schema import Scenario
from app.simulation.engines import Engine
from controllers.laws import KINDS
from parameters import allowed

Choice = TypeVar("Choice", bound=str)
Value = TypeVar("Value")
NO_DEFAULT_SHOWN: Any = tyro.conf.arg(help_behavior_hint="")  # the help shows no "(default: None)"
REPEATABLE: Any = tyro.conf.arg(help_behavior_hint="(repeatable)")  # the help of an option that may be typed again
Files = Annotated[tyro.conf.UseAppendAction[tuple[Path, ...]], tyro.conf.arg(metavar="FILE.py")]
Settings = Annotated[
    tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]],
    tyro.conf.arg(
        name="set", metavar="KEY=VALUE", help="change scenario fields, e.g. --set force.value=30 contact.K_e=2e4"
    ),
]
ENGINES: tuple[Engine, ...] = get_args(Engine)
LONGEST_NAME = 200  # letters of a scenario's name
DURATION = "simulation.duration"
MOST_WORKERS = 512  # processes of one machine


def one_of(flag: str, given: str, names: tuple[Choice, ...]) -> Choice:
    """The one of these names that was given to a flag. Raises ScenarioError with the one that was probably meant."""
    for name in names:
        if name == given:
            return name
    raise ScenarioError(f"{flag} {given!r:.60}; {allowed(given, names)}")


def braces(names: tuple[str, ...]) -> str:
    """Allowed names as a command's help shows them, in braces."""
    return f"{{{','.join(names)}}}"


def typed(*options: object) -> bool:
    """Whether one of these options was typed: has a value that is neither None nor empty."""
    return any(value is not None and value != () for value in options)


@dataclass(frozen=True)
class Default(Generic[Value]):
    """Default of an option whose parameter is None, or empty, where it is not typed, so that a typed value is told
    apart, also where it is the same. value: of the option that is not typed."""

    value: Value

    @property
    def hint(self) -> Any:
        """Annotation of the parameter, by which the command's help shows the default."""
        shown = " ".join(map(repr, self.value)) if isinstance(self.value, tuple) else self.value
        return tyro.conf.arg(help_behavior_hint=f"(default: {shown})")

    def unless(self, given: Value | None) -> Value:
        """Value of the option: the given one where one was typed, else the default."""
        return self.value if given is None or not typed(given) else given


ENGINE = Default("pinocchio")
EngineOption = Annotated[str | None, tyro.conf.arg(metavar=braces(ENGINES)), ENGINE.hint]


def engine_of(given: str | None, default: Default[str] = ENGINE) -> Engine:
    """The engine that was given to `--engine`, else the default one. Raises ScenarioError."""
    return one_of("--engine", default.unless(given), ENGINES)


def folder_of(command: str, out: Path | None) -> Path:
    """Folder of its own that was given to `--out` of this command. Raises ScenarioError."""
    if out is None:
        raise ScenarioError(f"{command}: no folder for the runs; allowed: --out FOLDER, or --dry-run")
    if out == Path():
        raise ScenarioError("--out: no folder of its own; allowed: the name of a folder")
    require_folder(out)
    return out


def require_folder(out: Path, flag: str = "--out") -> None:
    """Raise ScenarioError where no files can be written to a folder, before anything is computed for it. It may be one
    that is not there yet, and is not made."""
    for place in (out, *out.parents):
        try:
            place.lstat()
        except (FileNotFoundError, NotADirectoryError):
            continue
        except OSError as error:
            raise ScenarioError(f"{flag} {out}: cannot be written: {error.strerror}") from error
        if not place.is_dir():
            named = "" if place == out else f"{place} "
            what = "a file" if os.path.exists(place) else "a link to what is not there"
            raise ScenarioError(f"{flag} {out}: {named}is {what}; allowed: a folder")
        if not os.access(place, os.W_OK | os.X_OK):
            raise ScenarioError(f"{flag} {out}: {place} cannot be written; allowed: a folder of your own")
        try:  # only the attempt shows that nobody can make anything there, such as in /proc
            os.rmdir(tempfile.mkdtemp(prefix=".vsmrc-", dir=place))
        except OSError as error:
            raise ScenarioError(
                f"{flag} {out}: {place} cannot be written: {error.strerror}; allowed: a folder of your own"
            ) from error
        return


def require_workers(workers: int | None) -> None:
    """Raises ScenarioError for a number of worker processes that is not possible."""
    if workers is not None and not 1 <= workers <= MOST_WORKERS:
        raise ScenarioError(f"--workers {workers}; allowed: 1 to {MOST_WORKERS}")


def require_until(until: float | None) -> None:
    """Raises ScenarioError for an end of runs that is not possible, s."""
    if until is not None and not until > 0.0:
        raise ScenarioError(f"--until {until:g}; allowed: more than 0 s, at most the duration of the runs")


class UnwritableOutput(Exception):
    """Error of output that cannot be written, as on a full disk: one sentence."""


@contextmanager
def written_to(out: Path, besides: str = "", flag: str = "--out") -> Iterator[None]:
    """Context in which files are written to the folder or file of a flag; raises UnwritableOutput where they cannot
    be. besides: words after the reason."""
    try:
        yield
    except OSError as error:
        raise UnwritableOutput(f"{flag} {out}: cannot be written: {error.strerror}{besides}") from error


def use_own(files: tuple[Path, ...]) -> None:
    """Load the laws, surfaces and trajectories of a user's own files (`--use`). Raises ScenarioError."""
    if files:
        from app.scenario import own_code, own_laws

        own_code.use(files)
        own_laws.require_callable(own_code.own_code().laws.values())


def note_unused(*scenarios: Scenario) -> None:
    """Say on standard error which laws, surfaces and trajectories of a user's own files none of these scenarios has,
    and how they are chosen."""
    from app.scenario.own_code import own_code

    own = own_code()
    chosen = {f"controller.law={each.controller.law}" for each in scenarios}
    chosen |= {f"motion={kind_of(each.motion)}" for each in scenarios}
    chosen |= {f"surface={kind_of(met.form)}" for each in scenarios for met in each.surfaces}
    choices = (
        *(("law", kind, f"controller.law={kind}") for kind in own.laws),
        *(("surface", kind, f"surface={OWN}:{kind}") for kind in own.surfaces),
        *(("trajectory", kind, f"motion={OWN}:{kind}") for kind in own.trajectories),
    )
    for noun, kind, choice in choices:
        if choice not in chosen:
            print(f"vsmrc: note: the {noun} {kind} of --use is not used; --set {choice} chooses it", file=sys.stderr)


def note_without_effect(settings: Settings, *scenarios: Scenario, varied: Collection[str] = ()) -> None:
    """Say on standard error which typed fields have no effect in any of these scenarios, and what gives them one. A law
    of a user's own file may read `controller.d` all the same.
    varied: paths of fields that the runs vary."""
    typed = [
        f"{path}.{name}" if name else path
        for path, value in settings_of(settings)
        for name in (value if isinstance(value, dict) else ("",))
    ]
    for path in typed:
        reasons = [reason for each in scenarios if (reason := idle(each, path))]
        read_by_own_law = path == "controller.d" and any(each.controller.law not in KINDS for each in scenarios)
        if len(reasons) < len(scenarios) or read_by_own_law or reasons[0].choice in varied:
            continue
        chooses = f"--set {reasons[0].choice}={reasons[0].needed[0]} chooses it"
        print(f"vsmrc: note: {path} is not used {reasons[0].because}; {chooses}", file=sys.stderr)


def loaded(name_or_file: str) -> Scenario:
    """A shipped scenario or that of a file, see `load`. Raises ScenarioError, for a file or a folder that is no .toml
    file without the names of all scenarios."""
    if Path(name_or_file).suffix != ".toml" and name_or_file not in shipped() and os.path.exists(name_or_file):
        what = "a folder" if os.path.isdir(name_or_file) else "no .toml file"
        raise ScenarioError(
            f"scenario {name_or_file!r:.200}: is {what}; allowed: a file whose name ends in .toml, or a name of "
            "`vsmrc list`"
        )
    return load(name_or_file)


def configured(name_or_file: str, settings: Settings, duration: float | None = None) -> Scenario:
    """A shipped scenario or that of a file, with these settings and this duration, s. Raises ScenarioError."""
    scenario = loaded(name_or_file)
    changes = [_whole_section(scenario, *change) for change in settings_of(settings)]
    for number, (path, _) in enumerate(changes):
        if part := next((other for other, _ in changes[:number] if f"{other}.".startswith(f"{path}.")), None):
            raise ScenarioError(f"--set {path}: it would undo {part}, set before it; allowed: {path} first")
        if path in ("simulation", DURATION) and duration is not None:
            raise ScenarioError(f"--duration {duration:g}: --set {path} is given, too; allowed: one of both")
    if "robot" in dict(changes):
        scenario = with_value(scenario, "robot", dict(changes)["robot"])
    of_arm = [(path, value) for path, value in changes if path.startswith("robot.")]
    # the arm first, all its fields at once, then their entries: everything else may depend on it
    if of_arm:
        from app.session.changes import with_robot

        if whole := {path.removeprefix("robot."): value for path, value in of_arm if path == field_of(path)}:
            name = scenario.name
            scenario = with_robot(scenario, whole)
            # another arm's scenario has the name of one that has none
            if scenario.name == Scenario().name != name:
                scenario = msgspec.structs.replace(scenario, name=f"{name}-edited"[:LONGEST_NAME])
        for path, value in of_arm:
            if path != (field := field_of(path)):
                name = field.removeprefix("robot.")
                scenario = with_robot(scenario, {name: getattr(with_value(scenario, path, value).robot, name)})
    for path, value in changes:
        if path.split(".")[0] != "robot":
            scenario = with_value(scenario, path, value)
    if scenario.controller.law not in KINDS:
        from app.simulation.builders.controller_builder import law_of

        law_of(scenario)
    return scenario if duration is None else edited(scenario, DURATION, duration)


def _whole_section(scenario: Scenario, path: str, value: object) -> tuple[str, object]:
    """Path and value of a setting; the kind of a section that is to become another one, such as surface.kind, is that
    of the whole section, and the name of an arm that of its model."""
    if not isinstance(value, str):
        return path, value
    if path == "robot":
        return "robot.name", value
    section, _, last = path.rpartition(".")
    held = found_at(scenario, section)
    if last == "kind" and isinstance(held, msgspec.Struct) and held.__struct_config__.tag not in (None, value):
        return section, value
    return path, value


def settings_of(settings: Settings) -> list[tuple[str, object]]:
    """Paths and values of all that was typed behind `--set`, in order. Raises ScenarioError."""
    found = [setting(text) for group in settings for text in group]
    paths = [path for path, _ in found]
    if twice := next((path for path in paths if paths.count(path) > 1), None):
        raise ScenarioError(f"--set {twice}: it is set more than once; allowed: once")
    return found


def setting(text: str) -> tuple[str, object]:
    """Path and value of a text KEY=VALUE. Raises ScenarioError."""
    path, equals, value = text.partition("=")
    if not equals:
        raise ScenarioError(f"--set {text!r:.100}: no '='; allowed: KEY=VALUE")
    if not path.strip():
        raise ScenarioError(f"--set {text!r:.100}: no field; allowed: KEY=VALUE")
    return path.strip(), _value(value.strip())


def _value(text: str) -> object:
    """TOML value of a text; a text that is no TOML value, or more than one, is taken as it is."""
    try:
        found = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return found["value"] if len(found) == 1 else text


def shown(value: object) -> str:
    """A metric's value as the terminal shows it; a dash where it is none, as in metrics.json a number that is not
    finite."""
    if isinstance(value, list):
        return "  ".join(shown(v) for v in value)
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "—"
    return plain(value, 4) if isinstance(value, float) else str(value)
