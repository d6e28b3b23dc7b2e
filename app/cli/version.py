"""Option `vsmrc --version`: a file of its own, since it must not wait for the imports of the commands."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

from app.cli.status import DONE

PACKAGE = "vsmrc-lab"


def execute(arguments: list[str]) -> int:
    """Print the version of the program; returns the exit status. arguments: that were typed, `--version` alone."""
    del arguments
    try:
        print(f"{PACKAGE} {version(PACKAGE)}")
    except PackageNotFoundError:  # run from its folder without having been installed
        print(f"{PACKAGE}, not installed")
    return DONE
