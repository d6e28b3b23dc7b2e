"""`make fuzz ARGS="--seconds 60 --only formula urdf"`: every target for a while, and what was found.

Crash files go to build/fuzzing, which is not kept: what is found becomes a test. Exit status 1 when anything was.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import tyro

from fuzzing import TARGETS

FOUND = Path("build/fuzzing")


def fuzz(*, seconds: int = 60, only: tuple[str, ...] = tuple(TARGETS)) -> int:
    """Run the targets one after the other.

    Args:
        seconds: of each target
        only: names of targets, instead of all
    """
    FOUND.mkdir(parents=True, exist_ok=True)
    crashed = False
    for name in only:
        log = FOUND / f"{name}.log"
        with log.open("w") as out:
            status = subprocess.call(
                [sys.executable, "-m", "fuzzing.run", name, str(seconds), str(FOUND)], stdout=out, stderr=out
            )
        output = log.read_text(errors="replace")
        runs, cover = (re.findall(pattern, output) for pattern in (r"number_of_executed_units: (\d+)", r"cov: (\d+)"))
        verdict = "nothing found" if status == 0 else f"FOUND, exit status {status}: see {log}"
        inputs, branches = (found[-1] if found else "?" for found in (runs, cover))
        print(f"{name:12s} {inputs:>10s} inputs, {branches:>6s} branches  {verdict}", flush=True)
        crashed |= status != 0
    return int(crashed)


if __name__ == "__main__":
    sys.exit(tyro.cli(fuzz))
