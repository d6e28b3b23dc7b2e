"""Priority of computations beside the loop: lower, but where a whole machine is busy on purpose."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from app.process.priority import SAME


@pytest.mark.parametrize(("same", "lower"), [("", 7), ("1", 0)])
def test_what_steps_back_has_a_lower_priority_unless_all_shall_have_the_same(same: str, lower: int) -> None:
    code = "import os; from app.process.priority import step_back; step_back(7); print(os.nice(0))"
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {SAME: same}, capture_output=True, text=True, check=True
    )
    assert int(done.stdout) == min(os.nice(0) + lower, 19)
