"""Where uploaded URDFs are kept: below the user's data folder, each in a folder named after its contents.

A scenario names such a file by its path, so it can be saved, loaded and run headless; nothing here is ever deleted.
"""

from __future__ import annotations

import hashlib
import os
import re
from pathlib import Path

from app.scenario import ScenarioError
from app.whole_file import write_whole
from environments import urdf

MOST_KEPT = 500_000_000  # bytes: a page that uploads for ever must not fill the disk


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
        if not path.is_file() and (kept := _size(folder())) + len(content) > MOST_KEPT:
            raise ScenarioError(
                f"robot.urdf: {name:.60} has {len(content) / 1e6:.3g} MB, and {kept / 1e6:.3g} MB of uploads are kept "
                f"in {folder()}; allowed: {MOST_KEPT / 1e6:g} MB in all"
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, lambda file: file.write(content))
    except OSError as error:
        raise ScenarioError(f"robot.urdf: {name:.60} cannot be kept in {path.parent}: {error.strerror}") from error
    return path


def _size(folder: Path) -> int:
    """Bytes of all files below a folder."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def _plain(name: str) -> str:
    """A file name of letters, digits, '-' and '_' only, whatever the browser called it."""
    stem = re.sub(r"[^A-Za-z0-9_-]+", "_", re.sub(r"\.\w*$", "", name)).strip("_")
    return f"{stem[:60] or 'robot'}.urdf"
