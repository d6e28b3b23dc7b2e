"""Files of a user's own, named on the command line by `--use`: control laws, surfaces and trajectories beside those of
the program.

Nothing else can name such a file, neither a scenario nor an upload nor a page. Processes that this one starts read
the names from the environment.
"""

from __future__ import annotations

import ast
import inspect
import json
import os
import re
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from hashlib import sha256
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from msgspec import Struct

from app.scenario.errors import ScenarioError
from controllers.control_law import TOLD, ControlLaw, TorqueTerms
from controllers.laws.table import LAWS
from environments.own_function import MOST_PARAMETERS, OwnFunctionError
from environments.surfaces import own as own_surfaces
from environments.surfaces.chart import Shape
from environments.surfaces.own import OwnSurface
from environments.surfaces.table import SURFACES
from environments.trajectories import own as own_trajectories
from environments.trajectories.own import OwnTrajectory
from environments.trajectories.table import TRAJECTORIES
from environments.trajectories.trajectory import Course
from kernels import Kernel, compiled
from parameters import Parameter

VARIABLE = "VSMRC_USE"
_KIND, _NAME = re.compile("[a-z][a-z0-9]*(-[a-z0-9]+)*"), re.compile("[A-Za-z][A-Za-z0-9_]*")
_ALLOWED = (
    "a Python file with LAW = ControlLaw(...), SURFACE = OwnSurface(...) or TRAJECTORY = OwnTrajectory(...), see "
    "docs/extending.md"
)
_PLACES = re.compile(r'(?: at |File ")(.+?)(?:", line | \()(\d+)')  # as numba tells them, the innermost first
_ALLOCATES = ("NRT required but not enabled", "Only accept returning of array passed")  # numba's sentences
_UNKNOWN = re.compile(r"NameError: name '(\w+)' is not defined")
_Own = ControlLaw | OwnSurface | OwnTrajectory
_Member = TypeVar("_Member", OwnSurface, OwnTrajectory)


class OwnCodeError(ScenarioError):
    """A file of the user's own that cannot be used: one sentence with file, line and reason."""


@dataclass(frozen=True)
class OwnCode:
    """Contents of the files named by `--use`, by kind."""

    laws: dict[str, ControlLaw] = field(default_factory=dict)
    surfaces: dict[str, OwnSurface] = field(default_factory=dict)
    trajectories: dict[str, OwnTrajectory] = field(default_factory=dict)


def use(paths: Sequence[Path]) -> None:
    """Make the contents of these files available, in this process and in those that it starts. Raises OwnCodeError."""
    before = os.environ.get(VARIABLE, "")
    os.environ[VARIABLE] = json.dumps([(str(path.resolve()), _digest(path)) for path in paths])
    own_code.cache_clear()
    try:
        own_code()
    except OwnCodeError:
        os.environ[VARIABLE] = before
        raise


@cache
def own_code() -> OwnCode:
    """Contents of the files named by `--use`. Raises OwnCodeError."""
    found = OwnCode()
    for name_of_file, digest in json.loads(os.environ.get(VARIABLE) or "[]"):
        path = Path(name_of_file)
        if _digest(path) != digest:  # this process would compute with another law than the one that has started it
            raise OwnCodeError(
                f"--use {path}: the file has been changed since the start; allowed: start the command again"
            )
        module, empty = _loaded(path), True
        for name, kind, ours, known in _kinds(found):
            own = vars(module).get(name)
            if own is None:
                continue
            if not isinstance(own, kind):
                raise OwnCodeError(f"--use {path}: {name} is {shown(own)}; allowed: {_ALLOWED}")
            _check(own, ours, path)
            if own.kind in known:
                raise OwnCodeError(
                    f"--use {path}: kind {own.kind!r} is that of another file; allowed: a kind of its own"
                )
            known[own.kind], empty = own, False
        if empty:
            raise OwnCodeError(f"--use {path}: LAW, SURFACE and TRAJECTORY are missing; allowed: {_ALLOWED}")
    return found


def _kinds(found: OwnCode) -> list[tuple[str, type[Any], dict[str, str], dict[str, Any]]]:
    """Kinds of object that a file may define: name in the file, class, titles of the program's own ones by kind, dict
    to add to."""
    return [
        ("LAW", ControlLaw, {law.kind: law.title for law in LAWS.values()}, found.laws),
        ("SURFACE", OwnSurface, {_tag(form): form.title for form in SURFACES}, found.surfaces),
        ("TRAJECTORY", OwnTrajectory, {_tag(each): each.title for each in TRAJECTORIES}, found.trajectories),
    ]


def own_shape(form: own_surfaces.OwnForm) -> Shape:
    """Shape of a surface of the user's own, for kernels. Raises ValueError where no surface has this name or takes
    these parameters, OwnCodeError where it cannot be compiled."""
    own = _named("surface", form.name, own_code().surfaces)
    with _located_in(own.chart):
        return own.shape(form)


def own_course(path: own_trajectories.OwnPath, n: int, free: range) -> Course:
    """Course of a trajectory of the user's own, as a displacement of n coordinates, of which it may move those in
    `free`. Raises ValueError where no trajectory has this name or takes these parameters, OwnCodeError where it cannot
    be compiled."""
    own = _named("motion", path.name, own_code().trajectories)
    with _located_in(own.path):
        return own.course(path, n, free)


def _named(section: str, name: str, known: Mapping[str, _Member]) -> _Member:
    own = known.get(name)
    if own is None:
        there = ", ".join(known) or "none, since no file that --use names has one"
        raise ValueError(f"{section}.name: {name!r:.60}; allowed: {there}")
    return own


@contextmanager
def _located_in(function: Callable[..., None]) -> Iterator[None]:
    """Context in which an exception from the function's file becomes an OwnCodeError; a ValueError passes, with its own
    sentence."""
    try:
        yield
    except ValueError:
        raise
    except OwnFunctionError as error:
        raise OwnCodeError(f"{located(error.__cause__ or error, _file_of(function))}, {error}") from error
    except Exception as error:
        raise OwnCodeError(located(error, _file_of(function))) from error


def _file_of(function: Callable[..., None]) -> Path:
    return Path(inspect.getfile(inspect.unwrap(function)))


def own_fault(error: BaseException) -> OwnCodeError | None:
    """Sentence about an exception that a surface or a trajectory of the user's own has raised, with its file and line;
    None for any other, and for one that has its sentence already."""
    chain = _chain(error)
    if any(isinstance(each, OwnCodeError) for each in chain):
        return None
    own = own_code()
    functions = [each.chart for each in own.surfaces.values()] + [each.path for each in own.trajectories.values()]
    for path in map(_file_of, functions):
        for each in chain:
            if any(frame.filename == str(path) for frame in traceback.extract_tb(each.__traceback__)):
                return OwnCodeError(located(each, path))
    return None


def _chain(error: BaseException | None) -> list[BaseException]:
    """An exception, and those from which it was raised."""
    chain: list[BaseException] = []
    while error is not None:
        chain.append(error)
        error = error.__cause__
    return chain


def _tag(kind: type[Struct]) -> str:
    return str(kind.__struct_config__.tag)


def _digest(path: Path) -> str:
    """Digest of a file's content, "" where it cannot be read."""
    with suppress(OSError):
        if path.is_file():
            return sha256(path.read_bytes()).hexdigest()
    return ""


def _loaded(path: Path) -> ModuleType:
    spec = spec_from_file_location(f"own_{path.stem}", path)
    if path.suffix != ".py" or not path.is_file() or spec is None or spec.loader is None:
        raise OwnCodeError(f"--use {path}: no Python file; allowed: {_ALLOWED}")
    module = module_from_spec(spec)
    sys.modules[module.__name__] = module
    try:
        spec.loader.exec_module(module)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise OwnCodeError(f"--use {located(error, path)}") from error
    for each in vars(module).values():
        if isinstance(each, Kernel) and each.py_func.__module__ == module.__name__:
            each.check_indices()
    return module


def _check(own: _Own, ours: Mapping[str, str], path: Path) -> None:
    """Check an object of the user's own code. Raises OwnCodeError. ours: titles of the program's objects, by kind."""
    _require_texts(f"--use {path}:", kind=own.kind, title=own.title, about=own.about)
    if not (isinstance(own.parameters, tuple) and all(isinstance(p, Parameter) for p in own.parameters)):
        raise OwnCodeError(
            f"--use {path}: parameters {shown(own.parameters)}; allowed: a tuple, (Parameter(...), Parameter(...))"
        )
    if not _KIND.fullmatch(own.kind) or own.kind in ours:
        raise OwnCodeError(
            f"--use {path}: kind {own.kind!r:.60}; allowed: lower-case words joined by '-', but {', '.join(ours)}"
        )
    titles = ours.values()
    if own.title in ("", *titles):
        raise OwnCodeError(f"--use {path}: title {own.title!r:.60}; allowed: text other than {', '.join(titles)}")
    if isinstance(own, ControlLaw):
        _check_law(own, path)
    function = own.chart if isinstance(own, OwnSurface) else own.path if isinstance(own, OwnTrajectory) else None
    if function is not None and not compiled(function):
        raise OwnCodeError(
            f"--use {path}: {getattr(function, '__name__', function)} is not compiled; allowed: one decorated with "
            "kernels.inline or kernels.allocating"
        )
    if function is not None and len(own.parameters) > MOST_PARAMETERS:
        raise OwnCodeError(f"--use {path}: {len(own.parameters)} parameters; allowed: {MOST_PARAMETERS}")
    for p in own.parameters:
        _check_parameter(p, path)
    if twice := [name for name, count in Counter(p.name for p in own.parameters).items() if count > 1]:
        raise OwnCodeError(
            f"--use {path}: parameter {twice[0]!r} stands there more than once; allowed: one of each name"
        )


def _check_law(law: ControlLaw, path: Path) -> None:
    """Check what a law states of itself, of its inputs and of its torque. Raises OwnCodeError."""
    if law.robust:
        raise OwnCodeError(f"--use {path}: robust = True; allowed: False, Theorem 1 is about (25) and no other law")
    told: object = law.told
    if not isinstance(told, tuple) or not all(isinstance(each, str) and each in TOLD for each in told):
        raise OwnCodeError(f"--use {path}: told {shown(told)}; allowed: a tuple of {', '.join(map(repr, TOLD))}")
    terms: object = law.terms
    if terms is None:
        return
    fields = ", ".join(map(repr, TorqueTerms._fields))
    if not isinstance(terms, Mapping) or not terms or not all(each in TorqueTerms._fields for each in terms):
        raise OwnCodeError(f"--use {path}: terms {shown(terms)}; allowed: a name for one or more of {fields}")
    for name, text in terms.items():
        _require_texts(f"--use {path}: terms,", **{name: text})
    if "" in terms.values() or len(set(terms.values())) < len(terms):
        raise OwnCodeError(f"--use {path}: terms {shown(terms)}; allowed: another name for each")


def _require_texts(place: str, **given: object) -> None:
    for name, value in given.items():
        if not isinstance(value, str):
            raise OwnCodeError(f"{place} {name} {shown(value)}; allowed: text")


def _check_parameter(p: Parameter, path: Path) -> None:
    _require_texts(f"--use {path}: parameter", name=p.name)
    _require_texts(f"--use {path}: parameter {p.name:.60},", unit=p.unit, meaning=p.meaning)
    for name, number in (("value", p.value), ("low", p.low), ("high", p.high)):
        if not isinstance(number, float | int) or not abs(number) <= sys.float_info.max:
            raise OwnCodeError(
                f"--use {path}: parameter {p.name:.60}, {name} {shown(number)}; allowed: a finite number"
            )
    if not _NAME.fullmatch(p.name):
        raise OwnCodeError(f"--use {path}: parameter {p.name!r:.60}; allowed: letters, digits and '_'")
    if not p.low <= p.value <= p.high:
        raise OwnCodeError(f"--use {path}: {p.name} = {p.value:g}; allowed: {p.low:g} to {p.high:g}, its bounds")


def shown(value: object) -> str:
    """Beginning of a value of the user's own, which may not be able to show itself."""
    try:
        return f"{value!r:.60}"
    except Exception:
        return f"of the class {type(value).__name__}"


def _said(error: BaseException) -> str:
    """Text of an exception, "" where the user's own class does not give it."""
    try:
        return str(error)
    except Exception:
        return ""


def located(error: BaseException, path: Path) -> str:
    """Sentence about an error in a file, with the line of the file that was reached last."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    if isinstance(error, SyntaxError) and error.filename == str(path):
        lines = [error.lineno]
    text = _said(error)
    compiling = [line for file, line in _PLACES.findall(text) if Path(file).resolve() == path.resolve()]
    line = compiling[0] if compiling else lines[-1] if lines else _line_of_unknown_name(text, path)
    where = str(path) if line is None else f"{path}, line {line}"
    if any(said in text for said in _ALLOCATES):
        made = "a slice, a new array, list or text"
        return f"{where}: {made}; allowed: with kernels.allocating in place of kernels.inline"
    texts = [text.strip() for text in text.splitlines()]
    said = next((text for text in texts if text and not text.startswith("Failed in nopython mode")), "")
    said = re.sub(" of type .*| \\(.*, line \\d+\\)$", "", said)  # types as numba writes them fill pages
    return f"{where}: {type(error).__name__}: {said:.200}".rstrip(": ")


def _line_of_unknown_name(text: str, path: Path) -> int | None:
    """Line where a file first reads the name that numba does not know: numba tells it without its line."""
    unknown = _UNKNOWN.search(text)
    if unknown is None:
        return None
    names = (node for node in ast.walk(ast.parse(path.read_bytes())) if isinstance(node, ast.Name))
    return min((node.lineno for node in names if node.id == unknown[1]), default=None)
