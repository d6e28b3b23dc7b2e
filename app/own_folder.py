"""Folders that no other user of the machine can have a hand in: what is read from them is trusted, even as code."""

from __future__ import annotations

import os
import stat
from pathlib import Path

PRIVATE = 0o700


class NotOwnError(ValueError):
    """A folder that another user made or can change: what is the matter with it, to follow its name in a sentence."""


def own(path: Path) -> Path:
    """The folder, made where there is none (mode 700), with the links above it resolved.

    It is a real folder of this user, which nobody else can write, and nobody else can put another one in its place.
    Raises NotOwnError, and OSError where it cannot be made.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    # from here on the resolved path: a link above it may be given another target later
    path = path.parent.resolve(strict=True) / path.name
    path.mkdir(mode=PRIVATE, exist_ok=True)
    status = path.lstat()
    if not stat.S_ISDIR(status.st_mode):
        raise NotOwnError("is a symbolic link")
    if status.st_uid != os.geteuid():
        raise NotOwnError(f"belongs to another user (uid {status.st_uid})")
    if _others_write(status):
        raise NotOwnError(f"can be written by others (mode {stat.S_IMODE(status.st_mode):o})")
    for parent in path.parents:
        above = parent.stat()
        # in a sticky folder, such as /tmp, nobody moves what is another's
        if above.st_uid not in (0, os.geteuid()) or (_others_write(above) and not above.st_mode & stat.S_ISVTX):
            raise NotOwnError(f"is below {parent}, in which others can put another folder in its place")
    return path


def private(path: Path) -> Path:
    """The same, and nobody else can read it either. Raises NotOwnError and OSError."""
    path = own(path)
    path.chmod(PRIVATE)
    return path


def _others_write(status: os.stat_result) -> bool:
    """Where a group has the number of the user, it is the user's alone, as most systems make it."""
    users_own = status.st_gid == status.st_uid == os.geteuid()
    return bool(status.st_mode & (stat.S_IWOTH if users_own else stat.S_IWOTH | stat.S_IWGRP))
