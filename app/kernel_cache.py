"""Where compiled kernels are kept: one folder per state of the sources, so that no stale one is ever used."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from pathlib import Path

KEPT = 8  # folders of earlier states


def cache_folder() -> Path:
    """A writable folder named after the contents of every source file that holds kernels."""
    root = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for package in ("app", "controllers", "environments", "kernels"):
        for file in sorted((root / package).glob("*.py")):
            source = file.read_bytes()
            if b"kernel" in source:
                digest.update(file.name.encode() + source)
    for base in (os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", tempfile.gettempdir()):
        shelf = Path(base) / "vsmrc-lab"
        folder = shelf / digest.hexdigest()[:16]
        try:
            folder.mkdir(parents=True, exist_ok=True)
            folder.touch()  # the most recently used ones are kept
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            _forget_old(shelf)
            return folder
    raise OSError("no folder for compiled kernels: neither ~/.cache nor the temporary folder can be written")


def _forget_old(shelf: Path) -> None:
    folders = sorted((f for f in shelf.iterdir() if f.is_dir()), key=lambda f: f.stat().st_mtime)
    for folder in folders[:-KEPT]:
        shutil.rmtree(folder, ignore_errors=True)
