"""The `vsmrc` command within the process of the tests."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from app.cli import commands
from tests.support.commands import Done


@pytest.fixture
def here(capfd: pytest.CaptureFixture[str]) -> Callable[..., Done]:
    """`vsmrc` within this process, which is spared two seconds of imports; what `main` adds has tests of its own."""

    def execute(*arguments: str) -> Done:
        try:
            status = commands.execute([*arguments])
        except SystemExit as ended:
            status = int(ended.code or 0)
        return Done(status, *capfd.readouterr())

    return execute
