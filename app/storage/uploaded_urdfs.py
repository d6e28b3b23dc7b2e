"""Storage of uploaded URDFs, below the user's data folder, each in a folder named after its contents.

A scenario names such a file by its path, so it can be saved, loaded and run headless. When there are too many, files
that nobody has used for long are removed, first those of the visitor who has most. Beside a file lies an empty one for
each mark of a visitor who has uploaded it, see `app.gateway.visitors`.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import re
import shutil
import time
import weakref
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from app.process.atomic_write import write_whole
from app.process.base_directory import base_directory
from app.process.private_folder import PRIVATE, NotOwnError, private
from app.scenario.errors import ScenarioError
from environments import urdf
from environments.robots import Robot

MOST_KEPT, MOST_BYTES = 1000, 500_000_000  # files: a page that uploads for ever must not fill the disk
MOST_OF_ONE, BYTES_OF_ONE = 100, 100_000_000  # of one browser, and of one address
UNUSED = 30 * 86_400.0  # s
IDLE = 3600.0  # s
_BY = "by-"
_PRIVATE = 0o600


class _Upload(NamedTuple):
    path: Path
    size: int
    used: float  # s since 1970
    idle: bool
    marks: frozenset[str]


class UploadedUrdfs:
    """Uploaded URDFs of one visitor, on disk. marks: those of the visitor, once known; without marks, nothing is
    counted."""

    def __init__(self) -> None:
        self.marks: tuple[str, ...] = ()

    def keep(self, name: str, content: bytes) -> Path:
        """Path of the content, which is kept for the uploader with these marks; see `uploaded_urdfs.keep`."""
        return keep(name, content, self.marks)


def folder() -> Path:
    """Folder of the uploads: `$XDG_DATA_HOME/vsmrc-lab/urdf`, by default below ~/.local/share. Raises OSError for a
    user without a home folder."""
    return base_directory("XDG_DATA_HOME") / "urdf"


def _known_folder() -> Path | None:
    """Folder of the uploads; None for a user who can have none, so that no file is an upload."""
    try:
        return folder()
    except OSError:
        return None


def keep(name: str, content: bytes, marks: tuple[str, ...] = ()) -> Path:
    """The file that holds this URDF from now on; the same one for the same name and contents.

    marks: of the visitor who uploads it; the number of files of each mark is limited. Raises ScenarioError for a file
    that is no usable URDF, which is not kept, for too many files, and for a disk that cannot be written.
    """
    try:
        urdf.parse(content, name)
    except urdf.RobotError as error:
        raise ScenarioError(str(error)) from error
    try:
        path = folder() / hashlib.sha256(content).hexdigest()[:16] / _plain(name)
    except OSError as error:
        raise ScenarioError(f"robot.urdf: {name:.60} cannot be kept: {error.strerror}") from error
    try:
        if not path.is_file():
            _require_room(name, len(content), marks)
        private(folder())
        path.parent.mkdir(exist_ok=True, mode=PRIVATE)
        if path.is_file():  # a new file in its place would not be the one that `hold` has locked
            os.utime(path)
        else:
            write_whole(path, lambda file: file.write(content), _PRIVATE)
        for mark in marks:
            (path.parent / f"{_BY}{mark}").touch(_PRIVATE)
    except NotOwnError as error:
        raise ScenarioError(f"robot.urdf: {name:.60} cannot be kept: {folder()} {error}") from error
    except OSError as error:
        raise ScenarioError(f"robot.urdf: {name:.60} cannot be kept in {path.parent}: {error.strerror}") from error
    return path


@dataclass(frozen=True)
class FileAccess:
    """URDFs that a page may name: uploaded ones, and those that are `given`. Any other path is refused without looking
    for the file, so that nobody learns whether it exists."""

    given: tuple[str, ...] = ()

    def require(self, path: object) -> None:
        """Raises ScenarioError for a path that a page may not name."""
        if path is None or path in self.given:
            return
        uploads = _known_folder()
        if uploads is None or not Path(os.path.abspath(str(path))).is_relative_to(uploads):
            raise ScenarioError(
                f"robot.urdf: {str(path)!r:.200}: not on this server; allowed: a URDF that was uploaded"
            )


def lock_while_used(robot: Robot, path: str | None) -> None:
    """Keep the uploaded file that an arm was read from, as long as the arm is in use; any other file is left alone."""
    if path is None or Path(path).parents[1:2] != (_known_folder(),):
        return
    try:
        file = open(path, "rb")  # noqa: SIM115  # closed with the arm
        os.utime(path)
        fcntl.flock(file, fcntl.LOCK_SH)
    except OSError:  # the file may have been removed, which its reader reports
        return
    weakref.finalize(robot, file.close)


def note_use(path: str | None) -> None:
    """Note that an uploaded file is in use now; any other is left alone."""
    if path is not None and Path(path).parents[1:2] == (_known_folder(),):
        with contextlib.suppress(OSError):  # the file may have been removed, which its reader reports
            os.utime(path)


def _require_room(name: str, size: int, marks: tuple[str, ...]) -> None:
    """Make room for a file where there is none: remove as many files as needed of those not in use now.

    Raises ScenarioError where the rest is still too much.
    """
    kept = _uploads()
    for mark in marks:
        own = [upload for upload in kept if mark in upload.marks]
        gone = _made_room(own, size, marks, MOST_OF_ONE, BYTES_OF_ONE)
        kept = [upload for upload in kept if upload not in gone]
        if _too_many(own, size, MOST_OF_ONE, BYTES_OF_ONE):
            raise _refusal(name, size, own, "of one visitor", MOST_OF_ONE, BYTES_OF_ONE)
    _made_room(kept, size, marks, MOST_KEPT, MOST_BYTES)
    if _too_many(kept, size, MOST_KEPT, MOST_BYTES):
        raise _refusal(name, size, kept, "in all", MOST_KEPT, MOST_BYTES)


def _uploads() -> list[_Upload]:
    found = list[_Upload]()
    for file in folder().glob("*/*.urdf"):
        with contextlib.suppress(FileNotFoundError):  # another process removes, too
            status = file.stat()
            marks = frozenset(mark.name.removeprefix(_BY) for mark in file.parent.glob(f"{_BY}*"))
            idle = time.time() - status.st_mtime > IDLE and not _locked(file)
            found.append(_Upload(file, status.st_size, status.st_mtime, idle, marks))
    return found


def _made_room(uploads: list[_Upload], size: int, marks: tuple[str, ...], most: int, most_bytes: int) -> list[_Upload]:
    """Uploads that were removed, also from the given list: idle ones only, first those that nobody has used for long,
    then those of the visitor who has most, counting the file to come."""
    gone = list[_Upload]()
    while _too_many(uploads, size, most, most_bytes):
        count = Counter([*marks, *(mark for upload in uploads for mark in upload.marks)])
        idle = [upload for upload in uploads if upload.idle]
        if not idle:
            break
        unused = [upload for upload in idle if time.time() - upload.used > UNUSED]
        out = max(
            unused or idle, key=lambda upload: (max((count[mark] for mark in upload.marks), default=0), -upload.used)
        )
        _remove(out)
        uploads.remove(out)
        gone.append(out)
    return gone


def _too_many(uploads: list[_Upload], size: int, most: int, most_bytes: int) -> bool:
    return len(uploads) >= most or sum(upload.size for upload in uploads) + size > most_bytes


def _remove(upload: _Upload) -> None:
    upload.path.unlink(missing_ok=True)
    if not any(upload.path.parent.glob("*.urdf")):
        shutil.rmtree(upload.path.parent, ignore_errors=True)


def _refusal(name: str, size: int, uploads: list[_Upload], whose: str, most: int, most_bytes: int) -> ScenarioError:
    kept = sum(upload.size for upload in uploads)
    return ScenarioError(
        f"robot.urdf: {name:.60} has {size / 1e6:.3g} MB, and {len(uploads)} uploads of {kept / 1e6:.3g} MB are kept "
        f"in {folder()}; allowed: {most} of {most_bytes / 1e6:g} MB {whose}"
    )


def _locked(path: Path) -> bool:
    """Whether a run uses the file, however long since and whatever the clock says."""
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
