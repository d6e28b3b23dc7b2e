"""Options of a command as they were typed: names, numbers of values and kinds of value, checked before tyro reads them,
whose own messages name types of Python."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import tyro

from app.scenario.errors import ScenarioError
from parameters import allowed

NOUNS: dict[type, str] = {float: "a number", int: "a whole number", Path: "the name of a file or a folder"}
FOLDERS = ("out", "figures")  # options with the name of a folder
Command = Callable[..., int]


@dataclass(frozen=True)
class _Option:
    """Option of a command.
    kind: of its values; bool for a switch, which has none.
    count: number of its values; None for one or more.
    noun: one of its values, in words.
    needed: whether the command does nothing without it.
    repeats: whether it may be typed more than once, each time with further values."""

    kind: type
    count: int | None
    noun: str
    needed: bool
    repeats: bool

    def require(self, flag: str, values: list[str]) -> None:
        """Raise ScenarioError for values that it does not take."""
        if self.kind is bool:
            return
        if len(values) < (self.count or 1):
            wanted = {None: f"{self.noun}; one or more", 1: self.noun}.get(self.count, f"{self.count} numbers")
            raise ScenarioError(f"{flag}: {', '.join(values) or 'no value'}; allowed: {wanted}")
        for value in values[: self.count]:
            if not value:
                raise ScenarioError(f"{flag}: an empty text; allowed: {self.noun}")
            if self.kind in (int, float):
                try:
                    self.kind(value)
                except ValueError as error:
                    raise ScenarioError(f"{flag} {value!r:.60}; allowed: {self.noun}") from error


def require_options(name: str, command: Command, typed: list[str], others: Mapping[str, Command]) -> None:
    """Raise ScenarioError for what was typed behind a command:
    - an option that the command does not have; the message names commands of `others` that have it,
    - an option without a value, or with one of another kind,
    - an option that is typed twice, or an empty text,
    - a missing name or option that the command needs."""
    if {"--", "-h", "--help"} & set(typed):
        return
    options, waiting, most, names = _options(command), list(typed), _most_names(command), 0
    given: dict[str, str] = {}  # flags as they were typed, by the option
    needed = _needed_names(command)
    while waiting:
        token = waiting.pop(0)
        if not _flag(token):
            names += 1
            if not token:
                raise ScenarioError(f"{name}: an empty text; allowed: a name, see `vsmrc {name} --help`")
            if most is not None and names > most:
                single = [each for each in given if options[each].repeats and options[each].count == 1]
                more = f"{most}, and {single[0]} before each of its values" if single else most or "none"
                raise ScenarioError(
                    f"{name}: {token!r:.60} is one name too many; allowed: {more}, see `vsmrc {name} --help`"
                )
            continue
        flag, equals, value = token.partition("=")
        flag = flag.replace("_", "-")
        option = options.get(flag)
        if option is None:
            raise ScenarioError(f"{name}: {flag:.60}: no such option; {_instead(flag, options, others)}")
        values = [value] if equals else list(takewhile(lambda each: not _flag(each), waiting))
        option.require(flag, values)
        plain = flag.replace("--no-", "--", 1) if option.kind is bool else flag
        if plain in given and not option.repeats:
            several = ", with all its values behind it" if option.count is None else ""
            raise ScenarioError(f"{flag}: {given[plain]} was typed before; allowed: once{several}")
        given[plain] = flag
        if not equals:
            taken = 0 if option.kind is bool else len(values) if option.count is None else option.count
            del waiting[:taken]
    if names < len(needed):
        raise ScenarioError(f"{name}: no {needed[names]}; allowed: one, see `vsmrc {name} --help`")
    for flag, option in options.items():
        if option.needed and flag not in given:
            raise ScenarioError(f"{name}: no {flag}; allowed: {flag} with {option.noun}")


def _flag(token: str) -> bool:
    return token.startswith("--")


def _most_names(command: Command) -> int | None:
    """Most names that a command takes beside its options; None for any number."""
    hints, kind = get_type_hints(command), inspect.Parameter.KEYWORD_ONLY
    named = [each.name for each in inspect.signature(command).parameters.values() if each.kind is not kind]
    return None if any(_kind(hints[each])[1] is None for each in named) else len(named)


def _needed_names(command: Command) -> list[str]:
    """Names, as the command calls them, that have to be typed; any number of names may be none."""
    hints, kind = get_type_hints(command), inspect.Parameter.KEYWORD_ONLY
    named = [each for each in inspect.signature(command).parameters.values() if each.kind is not kind]
    needed = (each.name for each in named if each.default is inspect.Parameter.empty)
    return [name for name in needed if _kind(hints[name])[1] is not None]


def _instead(flag: str, options: Mapping[str, _Option], others: Mapping[str, Command]) -> str:
    """End of a refusal of an option: where there is one of this name, or those that are allowed."""
    takers = [f"`vsmrc {name}`" for name, command in others.items() if flag in _options(command)]
    if takers:
        return f"allowed: with {', '.join(takers)}"
    negated = flag.startswith("--no-")  # a switch is offered the way round that was typed
    return allowed(flag, (each for each in options if each.startswith("--no-") == negated))


def _options(command: Command) -> dict[str, _Option]:
    """Options of a command, by flag."""
    hints = get_type_hints(command, include_extras=True)
    found: dict[str, _Option] = {}
    for parameter in inspect.signature(command).parameters.values():
        if parameter.kind is not inspect.Parameter.KEYWORD_ONLY:
            continue
        hint = hints[parameter.name]
        arguments = list(_arguments(hint))
        name = next((each.name for each in arguments if each.name), parameter.name.replace("_", "-"))
        metavar = next((each.metavar for each in arguments if each.metavar), None)
        kind, count = _kind(hint)
        # of {svg,pdf} [...] only what stands in braces
        noun = metavar.partition("}")[0].strip("{").replace(",", ", ") if metavar else NOUNS.get(kind, "a text")
        if kind is Path and name in FOLDERS:
            noun = "the name of a folder"
        needed = parameter.default is inspect.Parameter.empty
        found[f"--{name}"] = _Option(kind, count, noun, needed, _repeats(hint))
        if kind is bool:
            found[f"--no-{name}"] = found[f"--{name}"]
    return found


def _arguments(hint: Any) -> Iterator[Any]:
    """What `tyro.conf.arg` has said of a parameter."""
    return (each for each in getattr(hint, "__metadata__", ()) if hasattr(each, "metavar"))


def _repeats(hint: Any) -> bool:
    """Whether an option of a parameter's type may be typed more than once."""
    return tyro.conf.UseAppendAction in getattr(hint, "__metadata__", ())


def _kind(hint: Any) -> tuple[type, int | None]:
    """Kind and number of the values of a parameter's type; of an option that is repeated, of each time."""
    repeats = _repeats(hint)
    while hasattr(hint, "__metadata__"):
        hint = hint.__origin__
    origin, inner = get_origin(hint), get_args(hint)
    if repeats:
        return _kind(inner[0])
    if origin in (Union, UnionType):
        return _kind(next(each for each in inner if each is not NoneType))
    if origin is not tuple:
        return hint, 1
    return _kind(inner[0])[0], None if inner[-1] is Ellipsis else len(inner)
