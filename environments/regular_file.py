"""Reading of files whose path somebody else chose: only regular files on a disk, which never block.

It is here because `urdf` reads by it and `environments` imports nothing of `app`, which reads by it, too.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path


def read_regular(path: Path, most: int) -> bytes:
    """Content of a file, cut after `most` bytes. Raises OSError, also for a folder, a pipe and a device; a file that
    the system generates on reading, as below /proc, is empty."""
    # to open a pipe may take for ever
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    with open(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "no regular file")
        return file.read(min(status.st_size, most))
