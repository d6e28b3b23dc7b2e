"""Session store on disk: links of sessions, and a folder for each, so that a gateway that is started again knows
them."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
from pathlib import Path
from typing import NamedTuple

import msgspec
import structlog

from app.process.atomic_write import write_whole
from app.process.json_text import decode_json
from app.storage.session_index import LARGEST, StateError, last_state, occupied, own_folder
from environments.regular_file import read_regular

log = structlog.get_logger()

MOST_STORED = 100  # sessions on disk: three pinned runs of a minute take 243 MB
LINK = "link.json"
_PRIVATE = 0o600
_GONE = ".gone-"  # begins the name of a folder that is being removed
_WORD = re.compile(r"[A-Za-z0-9_-]{1,64}")


class _Link(msgspec.Struct, frozen=True):
    name: str
    scenario: str
    owner: str = ""
    watch: str = ""


class StoredSession(NamedTuple):
    """A session as it was left: parts of its links, its scenario (TOML, not checked yet), the number of pinned runs,
    the browser of its owner, see `Visitor`, and its folder."""

    name: str
    watch: str
    scenario: str
    pinned: int
    owner: str
    folder: str


class SessionStore:
    """Sessions kept on disk, in a folder that only this gateway uses, until it ends or `close` is called.

    A session's own folder is named after its first link to watch: the pages show this name, and it lets nobody steer.
    The session's process keeps scenario and pinned runs there, see `app.session.autosave`. Raises StateError when
    another process uses the folder or it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        # also the folder above, which is the one that the user has named
        self._path, self._lock = occupied(own_folder(path.parent) / path.name)

    def close(self) -> None:
        """Unlock the folder for other processes."""
        os.close(self._lock)

    def known(self) -> list[StoredSession]:
        """Sessions that an earlier gateway left, the one not used for longest first; unreadable ones stay on disk, and
        are left out."""
        try:
            for unfinished in self._path.glob(f"*/.{LINK}.*"):
                unfinished.unlink()
            for gone in self._path.glob(f"{_GONE}*"):
                shutil.rmtree(gone, ignore_errors=True)
            links = [(link.stat().st_mtime, link) for link in self._path.glob(f"[!.]*/{LINK}")]
        except OSError as error:
            raise StateError(f"--state-dir {self._path}: cannot be read: {error.strerror}") from error
        return [known for _, link in sorted(links) if (known := _known(link)) is not None]

    def entered(self, known: StoredSession) -> Path:
        """Folder of the session, which is entered in the store. Where the folder cannot be written, the session's
        process will say so on the page."""
        try:
            self.enter(known)
        except OSError as error:
            log.warning("session not saved", reason=error.strerror)
        return self._path / known.folder

    def enter(self, known: StoredSession) -> None:
        """Write the session and its links to the store, instead of the earlier entry. Raises OSError."""
        folder = self._path / known.folder
        folder.mkdir(exist_ok=True, mode=0o700)
        text = msgspec.json.encode(_Link(known.name, known.scenario, known.owner, known.watch))
        write_whole(folder / LINK, lambda file: file.write(text), _PRIVATE)

    def forget(self, folder: str) -> None:
        """Remove the folder of this session, as far as possible; the rest of it at the next start."""
        gone = self._path / f"{_GONE}{folder}"
        with contextlib.suppress(OSError):
            os.replace(self._path / folder, gone)
        shutil.rmtree(gone, ignore_errors=True)


def _known(link: Path) -> StoredSession | None:
    folder = link.parent.name
    try:
        read = decode_json(read_regular(link, LARGEST), _Link)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        log.warning("saved session unreadable", session=folder[:6], reason=str(reason))
        return None
    watch = read.watch or folder  # files written before links could be renewed have no `watch`
    if not all(map(_WORD.fullmatch, (read.name, watch, folder))):
        log.warning("saved session unreadable", session=folder[:6], reason="its name is none of this program's")
        return None
    last = last_state(link.parent)
    return StoredSession(read.name, watch, last.scenario or read.scenario, last.pinned, read.owner, folder)
