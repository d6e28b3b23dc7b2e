"""Where uploaded URDFs are kept: below the user's data folder, each in a folder named after its contents.

A scenario names such a file by its path, so it can be saved, loaded and run headless. One that nobody uses, nor has for
long, makes room when there are too many.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from app.own_folder import PRIVATE, NotOwnError, private
from app.scenario import ScenarioError
from app.whole_file import write_whole
from environments import urdf

MOST_KEPT, MOST_BYTES = 1000, 500_000_000  # files: a page that uploads for ever must not fill the disk
UNUSED = 30 * 86_400.0  # s


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
        if not path.is_file():
            _require_room(name, len(content))
        private(folder())
        path.parent.mkdir(exist_ok=True, mode=PRIVATE)
        write_whole(path, lambda file: file.write(content), 0o600)
    except NotOwnError as error:
        raise ScenarioError(f"robot.urdf: {name:.60} cannot be kept: {folder()} {error}") from error
    except OSError as error:
        raise ScenarioError(f"robot.urdf: {name:.60} cannot be kept in {path.parent}: {error.strerror}") from error
    return path


@dataclass(frozen=True)
class Reach:
    """Which URDFs a page may name: uploaded ones, and those that are `given`. Whether there is any other file is not
    looked at, so that nobody learns it."""

    given: tuple[str, ...] = ()

    def require(self, path: object) -> None:
        """Raises ScenarioError for another one."""
        if path is None or path in self.given:
            return
        if not Path(os.path.abspath(str(path))).is_relative_to(folder()):
            raise ScenarioError(
                f"robot.urdf: {str(path)!r:.200}: not on this server; allowed: a URDF that was uploaded"
            )


def in_use(path: str | None) -> BinaryIO | None:
    """An uploaded file is in use now, and as long as what is returned is open; None for any other."""
    if path is None or Path(path).parents[1:2] != (folder(),):
        return None
    try:
        file = open(path, "rb")  # noqa: SIM115  # closed by who uses it
        os.utime(path)
        fcntl.flock(file, fcntl.LOCK_SH)
    except OSError:  # it may have gone: whoever reads it will say so
        return None
    return file


def _require_room(name: str, size: int) -> None:
    """Remove what nobody has used for long. Raises ScenarioError where the rest is still too much."""
    count, kept, now = 0, 0, time.time()
    for file in folder().glob("*/*.urdf"):
        with contextlib.suppress(FileNotFoundError):  # another process removes, too
            status = file.stat()
            if now - status.st_mtime > UNUSED and not _held(file):
                file.unlink()
            else:
                count, kept = count + 1, kept + status.st_size
    if count >= MOST_KEPT or kept + size > MOST_BYTES:
        raise ScenarioError(
            f"robot.urdf: {name:.60} has {size / 1e6:.3g} MB, and {count} uploads of {kept / 1e6:.3g} MB are kept in "
            f"{folder()}; allowed: {MOST_KEPT} of {MOST_BYTES / 1e6:g} MB in all"
        )


def _held(path: Path) -> bool:
    """Whether a run uses it, however long since and whatever the clock says."""
    try:
        with path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    return False


def _plain(name: str) -> str:
    """A file name of letters, digits, '-' and '_' only, whatever the browser called it."""
    stem = re.sub(r"[^A-Za-z0-9_-]+", "_", re.sub(r"\.\w*$", "", name)).strip("_")
    return f"{stem[:60] or 'robot'}.urdf"
