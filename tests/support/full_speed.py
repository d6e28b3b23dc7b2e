"""Background computations that do not yield to everything else: on a busy machine they would hardly get a turn."""

from __future__ import annotations

import os
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from app.sweep import background

CODE = "import sys; from app.workers import sweep; sweep.NICENESS = 0; sweep.main()"


def begin(module: str, *arguments: str, **options: Any) -> subprocess.Popen[bytes]:
    """Process that `app.process.launcher.start` would start, at the priority of this one."""
    assert module == "app.workers.sweep"
    return subprocess.Popen([sys.executable, "-c", CODE, *arguments], env=os.environ, process_group=0, **options)


@pytest.fixture
def full_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Maps and searches of this test are computed at its own priority."""
    monkeypatch.setattr(background, "launcher", SimpleNamespace(start=begin))
