"""Base directories of this user's files, as the XDG specification names them."""

from __future__ import annotations

import errno
import os
from pathlib import Path

_DEFAULTS = {"XDG_CACHE_HOME": ".cache", "XDG_DATA_HOME": ".local/share", "XDG_STATE_HOME": ".local/state"}


def base_directory(variable: str) -> Path:
    """Folder of this program below the base directory that a variable of the environment names, by default one below
    the home folder. A path that is not absolute is ignored, as the specification asks: it would name another folder
    for every working directory. Raises OSError for a user without a home folder, such as one without an account."""
    named = Path(os.environ.get(variable, ""))
    if named.is_absolute():
        return named / "vsmrc-lab"
    try:
        return Path.home() / _DEFAULTS[variable] / "vsmrc-lab"
    except RuntimeError as error:
        raise OSError(errno.ENOENT, f"there is no home folder; allowed: with HOME or {variable}") from error
