"""Log of a server that a benchmark looks at: what should not have happened to it."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class ServerLog:
    """Log file of a server and of the processes that it starts. file: for `--log-file`."""

    def __init__(self, file: Path) -> None:
        self.file = file

    @property
    def errors(self) -> list[str]:
        """Lines of level error so far, such as faults of the program."""
        lines = self.file.read_text(encoding="utf-8").splitlines() if self.file.exists() else []
        return [line for line in lines if " level=error " in line]


@contextmanager
def server_log() -> Iterator[ServerLog]:
    """Context with a new log, which is removed at its end."""
    with tempfile.TemporaryDirectory(prefix="vsmrc-log-") as folder:
        yield ServerLog(Path(folder) / "server.log")


def failures_in_words(failures: list[str], errors: list[str]) -> str:
    """Words for visits that failed and errors of the log."""
    kinds = ((failures, "visits were broken off"), (errors, "errors were logged"))
    return "; ".join(f"{len(each)} {what}" + (f" (first: {each[0]})" if each else "") for each, what in kinds)
