"""What `pip install` hands to a user: the code, and the files of static/ beside it."""

import os
import shutil
import subprocess
import sys
from fnmatch import filter as matching
from pathlib import Path
from zipfile import ZipFile

import pytest

pytestmark = pytest.mark.slow  # processes of its own

ROOT = Path(__file__).parents[2]
PACKAGES = ("app", "controllers", "environments", "kernels", "parameters", "static")


def pip(*arguments: str | Path) -> None:
    subprocess.run([sys.executable, "-m", "pip", "--quiet", *arguments], check=True)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy: setuptools writes into the tree it builds, and would ship what an earlier build left there."""
    source, built = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in PACKAGES:
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, source)
    pip("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", built, source)
    (wheel,) = built.glob("*.whl")
    return wheel


def test_wheel_carries_every_file(wheel: Path) -> None:
    with ZipFile(wheel) as archive:
        carried = {name for name in archive.namelist() if ".dist-info/" not in name}
        (entry_points,) = matching(archive.namelist(), "*.dist-info/entry_points.txt")
        assert "vsmrc = app.__main__:main" in archive.read(entry_points).decode()

    files = (path for name in PACKAGES for path in (ROOT / name).rglob("*") if path.is_file())
    assert carried == {path.relative_to(ROOT).as_posix() for path in files if "__pycache__" not in path.parts}
    assert matching(carried, "static/scenarios/*.toml")
    assert matching(carried, "static/robots/*.urdf")


def test_installed_wheel_runs_elsewhere(wheel: Path, tmp_path: Path) -> None:
    installed, elsewhere = tmp_path / "installed", tmp_path / "elsewhere"
    elsewhere.mkdir()
    pip("install", "--no-deps", "--target", installed, wheel)
    listing = subprocess.run(
        [sys.executable, "-m", "app", "list"],
        cwd=elsewhere,
        env=os.environ | {"PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
    )
    assert listing.returncode == 0, listing.stderr
    assert "ur5-hybrid" in listing.stdout
