"""Fingerprint of a program and of the arms that a sweep names, by which another version of either is noticed."""

from __future__ import annotations

import hashlib
import platform
from importlib.metadata import version
from pathlib import Path

from app.sweep.plan import Sweep
from environments.regular_file import read_regular
from environments.urdf import LARGEST as LARGEST_URDF

COMPUTED = ("app/analysis", "app/scenario", "app/session", "app/simulation", "app/storage", "app/sweep", "controllers",
            "environments", "kernels", "parameters")  # fmt: skip
ARMS = "static/robots"  # descriptions that come with the program
URDF = "robot.urdf"


def fingerprint(sweep: Sweep | None = None, packages: tuple[str, ...] = (), libraries: tuple[str, ...] = ()) -> str:
    """Fingerprint of all that the metrics of a run depend on besides the sweep: this program, the libraries that
    compute, the descriptions of arms, and the files that the sweep names as its arm. With more packages or
    libraries."""
    root, digest = Path(__file__).parents[2], hashlib.sha256()
    files = [file for package in (*COMPUTED, *packages) for file in sorted((root / package).rglob("*.py"))]
    for file in (*files, *sorted((root / ARMS).glob("*.urdf"))):
        digest.update(file.relative_to(root).as_posix().encode() + file.read_bytes())
    for urdf in own_urdfs(sweep) if sweep else ():
        digest.update(hashlib.sha256(_content(urdf)).digest())
    computing = ("example-robot-data", "numba", "numpy", "pin", "scipy", *libraries)
    versions = [f"python {platform.python_version()}", *(f"{name} {version(name)}" for name in computing)]
    digest.update(" ".join(versions).encode())
    return digest.hexdigest()[:16]


def another_program(sweep: Sweep) -> str:
    """Words for the cause of another fingerprint, which for a sweep of a user's own arm may be the arm's file."""
    return "another version of the program" + (f" or with another file as {URDF}" if own_urdfs(sweep) else "")


def own_urdfs(sweep: Sweep) -> list[str]:
    """Paths of the files that are the arms of a sweep, of those that do not come with the program."""
    varied = [value for axis in sweep.vary if axis.path == URDF for value in axis.values]
    return [str(path) for path in (sweep.scenario.robot.urdf, *varied) if path is not None]


def _content(urdf: str) -> bytes:
    """Content of an arm's file; none of one that cannot be read, whose runs say so."""
    try:
        return read_regular(Path(urdf).expanduser(), LARGEST_URDF + 1)
    except (OSError, ValueError, RuntimeError):
        return b""
