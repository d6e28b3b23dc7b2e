"""Where uploaded URDFs are kept: below the user's data folder, each in a folder named after its contents.

A scenario names such a file by its path, so it can be saved, loaded and run headless. Where they become too many, those
uploaded longest ago go.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
from pathlib import Path

from app.scenario import ScenarioError
from app.whole_file import write_whole
from environments import urdf

MOST_KEPT, MOST_BYTES = 1000, 500_000_000  # files: a page that uploads for ever must not fill the disk


def folder() -> Path:
    """`$XDG_DATA_HOME/vsmrc-lab/urdf`, by default below ~/.local/share."""
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share") / "vsmrc-lab" / "urdf"


def keep(name: str, content: bytes) -> Path:
    """The file that holds this URDF from now on; the same one for the same name and contents.

    Raises ScenarioError for what is no usable URDF, which is not kept, and for a disk that takes none.
    """
    try:
        urdf.parse(content, name)
    except urdf.RobotError as error:
        raise ScenarioError(str(error)) from error
    path = folder() / hashlib.sha256(content).hexdigest()[:16] / _plain(name)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, lambda file: file.write(content))
        _make_room(path)
    except OSError as error:
        raise ScenarioError(f"robot.urdf: {name:.60} cannot be kept in {path.parent}: {error.strerror}") from error
    return path


def _make_room(newest: Path) -> None:
    """Remove what was uploaded longest ago, but never the newest, until the rest is not too much."""
    found = [(file.stat(), file) for file in folder().glob("*/*.urdf") if file != newest]
    found.sort(key=lambda each: each[0].st_mtime)
    count, size = len(found) + 1, sum(status.st_size for status, _ in found) + newest.stat().st_size
    for status, file in found:
        if count <= MOST_KEPT and size <= MOST_BYTES:
            return
        file.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # another file is in it
            file.parent.rmdir()
        count, size = count - 1, size - status.st_size


def _plain(name: str) -> str:
    """A file name of letters, digits, '-' and '_' only, whatever the browser called it."""
    stem = re.sub(r"[^A-Za-z0-9_-]+", "_", re.sub(r"\.\w*$", "", name)).strip("_")
    return f"{stem[:60] or 'robot'}.urdf"
