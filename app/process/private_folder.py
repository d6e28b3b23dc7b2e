"""Private folders, which no other user of the machine can change: files read from them are trusted, even as code."""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import os
import shutil
import stat
import tempfile
from pathlib import Path

PRIVATE = 0o700
_FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW  # flags that open a folder, and no link to one


class NotOwnError(ValueError):
    """A folder that another user made or can change: the reason, to follow the folder's name in a sentence."""


def own(path: Path) -> Path:
    """The folder, made where there is none (mode 700), with the links above it resolved.

    It is a real folder of this user, which nobody else can write, and which nobody else can replace by another one.
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
        # in a sticky folder, such as /tmp, nobody can move what belongs to another user
        if above.st_uid not in (0, os.geteuid()) or (_others_write(above) and not above.st_mode & stat.S_ISVTX):
            raise NotOwnError(f"is below {parent}, in which others can put another folder in its place")
    return path


def private(path: Path) -> Path:
    """The folder as `own` returns it, which nobody else can read either. Raises NotOwnError and OSError."""
    path = own(path)
    path.chmod(PRIVATE)
    return path


def passing(prefix: str) -> Path:
    """Temporary folder with a name that nobody can foresee, only for this process and those that it starts.

    The folder is removed when this process ends. After a process that was killed, its folder is removed when another
    process asks for a folder of this prefix, since the lock on it has ended with its holder.
    """
    _remove_left(prefix)
    maker = os.getpid()
    while not _held(folder := Path(tempfile.mkdtemp(prefix=prefix))):
        pass  # another process took it for left behind, in the instant before it was locked

    def remove() -> None:
        if os.getpid() == maker:  # not in a fork of the maker
            shutil.rmtree(folder, ignore_errors=True)

    atexit.register(remove)
    return folder


def _held(folder: Path) -> bool:
    """Whether the folder is locked until this process ends; False where another process is removing it."""
    try:
        file = os.open(folder, _FOLDER)
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return os.path.samestat(os.fstat(file), folder.lstat())
    except (FileNotFoundError, BlockingIOError):
        return False
    except OSError:  # no locks on this disk: no other process can lock it either
        return True


def _remove_left(prefix: str) -> None:
    """Remove the folders of this user that `passing` made and that no process holds any more."""
    for folder in Path(tempfile.gettempdir()).glob(f"{prefix}*"):
        with contextlib.suppress(OSError), contextlib.ExitStack() as opened:
            file = os.open(folder, _FOLDER)
            opened.callback(os.close, file)
            status = os.fstat(file)
            if status.st_uid == os.geteuid() and stat.S_IMODE(status.st_mode) == PRIVATE:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder)


def _others_write(status: os.stat_result) -> bool:
    """Whether other users can write. A group with the number of the user has this user only, as most systems make
    it."""
    users_own = status.st_gid == status.st_uid == os.geteuid()
    return bool(status.st_mode & (stat.S_IWOTH if users_own else stat.S_IWOTH | stat.S_IWGRP))
