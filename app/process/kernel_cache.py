"""Cache folder of compiled kernels: one folder per tree and state of its sources, so that no stale kernel is ever used.

Numba reads kernels back as pickles, and whoever can write a pickle runs code. So the folder is one that no other user
can change, or a temporary one.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
from pathlib import Path

from app.process.base_directory import base_directory
from app.process.private_folder import NotOwnError, passing, private

KEPT = 8  # folders of earlier states
VARIABLE = "NUMBA_CACHE_DIR"  # read by numba; the processes beside this one inherit it


def choose() -> None:
    """Choose numba's cache folder, unless the user or the process that started this one has chosen one. To be called
    before numba is imported."""
    if VARIABLE not in os.environ:
        os.environ[VARIABLE] = str(_lasting() or passing("vsmrc-kernels-"))


def cache_folder() -> Path:
    """The cache folder that was chosen."""
    return Path(os.environ[VARIABLE])


def _lasting() -> Path | None:
    """Private folder below the user's cache, named after the place and the contents of every source file that
    kernels depend on; None, with a sentence on the terminal, where there can be none."""
    shelf = "the user's cache"
    try:
        shelf = base_directory("XDG_CACHE_HOME")
        folder = private(private(shelf) / _digest())
        folder.touch()  # the most recently used ones are kept
        _forget_old(folder.parent)
    except (OSError, NotOwnError) as error:
        reason = f"cannot be written: {error.strerror}" if isinstance(error, OSError) else error
        print(f"vsmrc: {shelf} {reason}; compiled kernels are not kept for the next start", file=sys.stderr)
        return None
    return folder


def _digest() -> str:
    root = Path(__file__).parents[2]
    digest = hashlib.sha256(bytes(root))  # numba finds a kernel by the path of its file: copies of a tree share none
    for package in ("app", "controllers", "environments", "kernels"):
        for file in sorted((root / package).rglob("*.py")):
            source = file.read_bytes()
            # of a package beside `app`, a file without kernels may have numbers that kernels were compiled with
            if package != "app" or b"\nfrom kernels" in source:
                digest.update(file.name.encode() + source)
    return digest.hexdigest()[:16]


def _forget_old(shelf: Path) -> None:
    folders = sorted((f for f in shelf.iterdir() if f.is_dir()), key=lambda f: f.stat().st_mtime)
    for folder in folders[:-KEPT]:
        shutil.rmtree(folder, ignore_errors=True)
