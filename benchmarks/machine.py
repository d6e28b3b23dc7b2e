"""Description of the machine on which the benchmarks were measured."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path

MEASURED = ("numpy", "numba", "pin", "viser", "mujoco")


def describe() -> str:
    """Description of the machine in a paragraph: processor, memory, system, versions, and how busy it is now."""
    cpu = _after(Path("/proc/cpuinfo"), "model name") or platform.processor() or platform.machine()
    memory = _after(Path("/proc/meminfo"), "MemTotal")
    size = f", {int(memory.split()[0]) / 2**20:.0f} GiB" if memory else ""
    packages = ", ".join(f"{name} {version(name)}" for name in MEASURED)
    return (
        f"{cpu}, {os.cpu_count()} cores{size}; {platform.system()} {platform.release()}; "
        f"Python {platform.python_version()}, {packages}. Load average when the run began: {os.getloadavg()[0]:.1f}."
    )


def _after(file: Path, key: str) -> str | None:
    """Value of the first line `key : value`, None where there is no such file or line."""
    if not file.exists():
        return None
    lines = file.read_text(encoding="utf-8").splitlines()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith(key)), None)
