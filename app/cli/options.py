"""Options that several commands have, and how they are read."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, TypeVar, get_args

import tyro

from app.scenario.data import edited, field_of, load, with_value
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.simulation.engines import Engine
from controllers.laws import KINDS
from parameters import allowed

Choice = TypeVar("Choice", bound=str)
Value = TypeVar("Value")
Files = Annotated[tyro.conf.UseAppendAction[tuple[Path, ...]], tyro.conf.arg(metavar="FILE.py")]
Settings = Annotated[
    tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]],
    tyro.conf.arg(name="set", metavar="KEY=VALUE", help="change fields, e.g. --set force.value=30 contact.K_e=2e4"),
]
ENGINES: tuple[Engine, ...] = get_args(Engine)
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


def usually(value: object) -> str:
    """Hint of a command's help at an option that has this value where it is not typed. Its parameter is None there, so
    that a typed value is told apart, whatever it is."""
    return f"(default: {value})"


def typed(*options: object) -> bool:
    """Whether one of these options was typed: has a value that is neither None nor empty."""
    return any(value is not None and value != () for value in options)


def otherwise(value: Value | None, usual: Value) -> Value:
    """Value of an option that was typed, else the usual one."""
    return usual if value is None else value


def folder_of(command: str, out: Path | None) -> Path:
    """Folder of its own that was given to `--out` of this command. Raises ScenarioError."""
    if out is None:
        raise ScenarioError(f"{command}: no folder for the runs; allowed: --out FOLDER, or --dry-run")
    if out == Path():  # also what an empty text is
        raise ScenarioError("--out: no folder of its own; allowed: the name of a folder")
    return out


def require_workers(workers: int | None) -> None:
    """Raises ScenarioError for a number of worker processes that is not possible."""
    if workers is not None and not 1 <= workers <= MOST_WORKERS:
        raise ScenarioError(f"--workers {workers}; allowed: 1 to {MOST_WORKERS}")


def require_until(until: float | None) -> None:
    """Raises ScenarioError for an end of runs that is not possible, s."""
    if until is not None and not until > 0.0:
        raise ScenarioError(f"--until {until:g}; allowed: more than 0 s, at most the duration of the runs")


@contextmanager
def written_to(out: Path, besides: str = "") -> Iterator[None]:
    """Context in which files are written to `--out`; raises ScenarioError where they cannot be. besides: words after
    the reason."""
    try:
        yield
    except OSError as error:
        raise ScenarioError(f"--out {out}: cannot be written: {error.strerror}{besides}") from error


def use_own(files: tuple[Path, ...]) -> None:
    """Load the laws, surfaces and trajectories of a user's own files (`--use`). Raises ScenarioError."""
    if files:
        from app.process import own_code

        own_code.use(files)


def configured(name_or_file: str, settings: Settings, duration: float | None = None) -> Scenario:
    """A shipped scenario or that of a file, with these settings and this duration, s. Raises ScenarioError."""
    scenario = load(name_or_file)
    changes = settings_of(settings)
    of_arm = [(path, value) for path, value in changes if path.startswith("robot.")]
    # the arm first, all its fields at once, then their entries: everything else may depend on it
    if of_arm:
        from app.session.changes import with_robot

        if whole := {path.removeprefix("robot."): value for path, value in of_arm if path == field_of(path)}:
            scenario = with_robot(scenario, whole)
        for path, value in of_arm:
            if path != (field := field_of(path)):
                name = field.removeprefix("robot.")
                scenario = with_robot(scenario, {name: getattr(with_value(scenario, path, value).robot, name)})
    for path, value in changes:
        if not path.startswith("robot."):
            scenario = with_value(scenario, path, value)
    if scenario.controller.law not in KINDS:
        from app.simulation.controller_builder import law_of

        law_of(scenario)
    return scenario if duration is None else edited(scenario, "simulation.duration", duration)


def settings_of(settings: Settings) -> list[tuple[str, object]]:
    """Paths and values of all that was typed behind `--set`, in order. Raises ScenarioError."""
    return [setting(text) for group in settings for text in group]


def setting(text: str) -> tuple[str, object]:
    """Path and value of a text KEY=VALUE. Raises ScenarioError."""
    path, equals, value = text.partition("=")
    if not equals:
        raise ScenarioError(f"--set {text}: no '='; allowed: KEY=VALUE")
    return path.strip(), _value(value.strip())


def _value(text: str) -> object:
    """TOML value of a text; a text that is no TOML value is taken as it is."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text


def shown(value: object) -> str:
    """A figure's value as the terminal shows it."""
    if isinstance(value, list):
        return "  ".join(shown(v) for v in value)
    return f"{value:.4g}" if isinstance(value, float) else "—" if value is None else str(value)
