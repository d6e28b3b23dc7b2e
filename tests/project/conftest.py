"""The `vsmrc` command within the process of the tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

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


@pytest.fixture
def refuses(here: Callable[..., Done], tmp_path: Path) -> Callable[[tuple[str, ...], str], None]:
    """Test of a command that writes to a folder: it is refused with a message, and writes nothing."""

    def require(arguments: tuple[str, ...], message: str) -> None:
        done = here(*arguments, "--out", str(tmp_path / "out"))
        assert done.returncode == 2
        assert message in done.stderr
        assert "Traceback" not in done.stderr
        assert not (tmp_path / "out").exists()

    return require
