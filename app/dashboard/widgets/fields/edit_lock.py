"""Lock on edits: while the goal of a lesson is open, only its controls change the run."""

from __future__ import annotations

from collections.abc import Callable

from app.dashboard.widgets.fields.field_words import called
from app.lessons.words import ENGLISH
from app.session.commands import (
    BeginScenario,
    Blend,
    Command,
    Continue,
    DragTool,
    Edit,
    EditAll,
    EditModel,
    Load,
    PushNow,
    TakeWayOut,
)
from app.session.model_entries import CHANGED_BY

# commands that change the run and are no edits, and their names in a refusal
_OTHERS = {
    Blend: "a blend",
    Load: "another scenario",
    BeginScenario: "another scenario",
    Continue: "the last session",
    PushNow: "a push",
    TakeWayOut: "the way out",
}


class EditLock:
    """Lock in front of the runner: passes every command, or, while it is closed, of the changes only edits of `fields`.

    fields: dotted paths, None while the lock is open.
    words: of the lesson that is open, in which the lock complains.
    """

    def __init__(self, post: Callable[[Command], int], complain: Callable[[str], None]) -> None:
        self._post, self._complain = post, complain
        self.fields: frozenset[str] | None = None
        self.words = ENGLISH

    def post(self, command: Command) -> int | None:
        """Pass a command on to the runner. Returns its number there, from 1 on; None for a command that is locked, and
        complains of it."""
        locked = self._locked(command)
        if not locked:
            return self._post(command)
        allowed = ", ".join(map(called, sorted(self.fields or ())))
        self._complain(self.words.locked_but.format(locked, allowed))
        return None

    def _locked(self, command: Command) -> str:
        """Words for what is locked of a command, "" for nothing."""
        if self.fields is None:
            return ""
        match command:
            case Edit(path):
                return "" if path in self.fields else called(path)
            case EditAll(values):
                return ", ".join(called(path) for path in values if path not in self.fields)
            case EditModel(entries):
                names = dict.fromkeys(name for each in entries for name in CHANGED_BY.get(each, (each,)))
                paths = [f"target_model.{name}" for name in names]
                return ", ".join(called(path) for path in paths if path not in self.fields)
            case DragTool(grip):
                return "" if grip is None else "a push by hand"
            case _:
                return _OTHERS.get(type(command), "")

    def refuses(self, what: str) -> bool:
        """Whether the lock is closed; then it complains that `what`, which no goal allows, is locked."""
        if self.fields is None:
            return False
        self._complain(self.words.locked.format(what))
        return True
