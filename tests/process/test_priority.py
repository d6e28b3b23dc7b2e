"""Priority of computations beside the loop: lower, but where a whole machine is busy on purpose."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from app.process.priority import SAME


@pytest.mark.parametrize(("same", "lower"), [("", 7), ("1", 0)])
def test_helper_processes_are_nice_unless_same_priority_is_set(same: str, lower: int) -> None:
    code = "import os; from app.process.priority import lower_priority; lower_priority(7); print(os.nice(0))"
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {SAME: same}, capture_output=True, text=True, check=True
    )
    assert int(done.stdout) == min(os.nice(0) + lower, 19)
