"""`make test` ends with what failed, also in the setup of a test."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from drivers.failures import failures

TESTS = """
import pytest

@pytest.fixture
def broken():
    raise ValueError("no page")

def test_waits(broken): pass

def test_adds(): assert 1 + 1 == 3

def test_passes(): pass
"""


def test_what_failed_is_told_by_name_and_with_its_last_lines(tmp_path: Path) -> None:
    (tmp_path / "test_some.py").write_text(TESTS, encoding="utf-8")
    report = tmp_path / "report.xml"
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", f"--junitxml={report}", "test_some.py"]
    assert subprocess.run(command, cwd=tmp_path, capture_output=True, check=False).returncode == 1
    error, failure, missing = failures([report, tmp_path / "other.xml"])
    assert error.startswith("ERROR test_some.test_waits: ")
    assert error.endswith("ValueError")
    assert "no page" in error
    assert failure.startswith("FAILURE test_some.test_adds: ")
    assert "assert (1 + 1) == 3" in failure
    assert missing == f"{tmp_path}/other.xml: no report of this part; see what it printed"
