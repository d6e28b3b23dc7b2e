"""Index of a session's folder: the session's scenario and its pinned runs; read without a simulation."""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path
from typing import NamedTuple, TypeVar

import msgspec

from app.process.json_text import decode_json
from app.process.private_folder import NotOwnError, own
from environments.regular_file import read_regular

FORMAT, VERSION = "vsmrc-lab session", 1
SESSION, OFFER, LOCK = "session.json", "offer.json", "lock"
PINS = 3  # runs that a session keeps for comparison
LARGEST = 4_000_000  # bytes of an index
_PRIVATE = 0o600
Decoded = TypeVar("Decoded")
_LATEST = 253_402_300_799.0  # s since 1970: the last second of the year 9999, which a date can have


class StateError(ValueError):
    """A folder, or a file in it, that cannot be used: one sentence."""


class SavedRun(msgspec.Struct, frozen=True):
    """A pinned run of a folder: its number, the instant t (s) at which it was pinned, its file, and its name if the
    user has given it one."""

    number: int
    t: float
    file: str
    name: str = ""


class _Kind(msgspec.Struct, frozen=True):
    format: str = ""
    version: int = 0


class Index(msgspec.Struct, frozen=True):
    """Contents of an index file: when it was saved (s since 1970), the scenario as TOML, the pinned runs."""

    saved: float
    scenario: str
    pinned: list[SavedRun]
    format: str = FORMAT
    version: int = VERSION


def occupied(path: Path) -> tuple[Path, int]:
    """Make the folder and lock it, until the returned file is closed or this process ends; also returns the path with
    the links above the folder resolved.

    Raises StateError when another process has the folder, it cannot be written, or another user can change it.
    """
    path = own_folder(path)
    try:
        lock = os.open(path / LOCK, os.O_RDWR | os.O_CREAT, _PRIVATE)
    except OSError as error:
        raise StateError(f"--state-dir {path}: cannot be written: {error.strerror}") from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(lock)
        raise StateError(f"--state-dir {path}: another server uses it; allowed: a folder of its own") from error
    except OSError as error:
        os.close(lock)
        raise StateError(f"--state-dir {path}: cannot be locked: {error.strerror}; allowed: another disk") from error
    return path, lock


def own_folder(path: Path) -> Path:
    """The folder, made where there is none, with the links above it resolved. Raises StateError when it cannot be
    written, or another user can change it."""
    try:
        return own(path)
    except NotOwnError as error:
        raise StateError(f"--state-dir {path}: {error}; allowed: a folder that only its owner can write") from error
    except OSError as error:
        raise StateError(f"--state-dir {path}: cannot be written: {error.strerror}") from error


class Last(NamedTuple):
    """Last state of a session: its scenario as TOML, not checked, None where it is unknown; and the number of its
    pinned runs."""

    scenario: str | None
    pinned: int


def last_state(path: Path) -> Last:
    """Last state of this folder's session, read without locking the folder."""
    found = list[Index]()
    for name in (SESSION, OFFER):
        with contextlib.suppress(FileNotFoundError, StateError):
            found.append(decoded(path / name))
    return Last(found[0].scenario if found else None, sum(len(index.pinned) for index in found))


def decoded(path: Path) -> Index:
    """Index in this file; its scenario is not checked. Raises FileNotFoundError and StateError."""
    try:
        content = read_regular(path, LARGEST + 1)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise StateError(f"{path} cannot be read: {error.strerror}") from error
    if len(content) > LARGEST:
        raise StateError(f"{path} has more than {LARGEST / 1e6:g} MB")
    kind = _decoded(content, _Kind, path)
    if kind.format != FORMAT:
        raise StateError(f"{path} is no session of this program")
    if kind.version > VERSION:
        raise StateError(f"{path} was written by a newer version of this program")
    index = _decoded(content, Index, path)
    if not 0.0 <= index.saved <= _LATEST:
        raise StateError(f"{path} is no session of this program: saved {index.saved:g} s after 1970")
    return index if len(index.pinned) <= PINS else msgspec.structs.replace(index, pinned=index.pinned[-PINS:])


def _decoded(content: bytes, kind: type[Decoded], path: Path) -> Decoded:
    try:
        return decode_json(content, kind)
    except ValueError as error:
        raise StateError(f"{path} is no session of this program") from error
