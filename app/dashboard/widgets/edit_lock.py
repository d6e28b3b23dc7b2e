"""Lock on edits: while the goal of a lesson is open, only its controls change the run."""

from __future__ import annotations

from collections.abc import Callable

from app.session.commands import Blend, Command, Continue, Edit, EditAll, Load, Push, PushNow, TakeWayOut

# commands that change the run and are no edits, and their names in a refusal
_OTHERS = {
    Blend: "a blend",
    Load: "another scenario",
    Continue: "the last session",
    PushNow: "a push",
    TakeWayOut: "the way out",
}


class EditLock:
    """Lock in front of the runner: passes every command, or, while it is closed, of the changes only edits of `fields`.

    fields: dotted paths, None while the lock is open.
    """

    def __init__(self, post: Callable[[Command], None], complain: Callable[[str], None]) -> None:
        self._post, self._complain = post, complain
        self.fields: frozenset[str] | None = None

    def post(self, command: Command) -> None:
        """Pass a command on to the runner, or complain where it is locked."""
        match command:
            case Edit(path) if self.fields is not None and path not in self.fields:
                self._refuse(path)
            case EditAll(values) if self.fields is not None and not self.fields >= values.keys():
                self._refuse(", ".join(values))
            case Push(grip) if self.fields is not None and grip is not None:
                self._refuse("a push by hand")
            case _ if self.fields is not None and type(command) in _OTHERS:
                self._refuse(_OTHERS[type(command)])
            case _:
                self._post(command)

    def refuses(self, what: str) -> bool:
        """Whether the lock is closed; then it complains that `what`, which begins another run, is locked."""
        if self.fields is None:
            return False
        self._complain(f"{what}: locked by the goal of a lesson; allowed: leave the lesson")
        return True

    def _refuse(self, what: str) -> None:
        allowed = ", ".join(sorted(self.fields or ()))
        self._complain(f"{what}: locked by the goal of a lesson; allowed: {allowed}, or leave the lesson")
