"""What a command loads: only what it needs, so that none waits for the page's or the simulation's libraries."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow  # processes of its own

RUN = "from app.cli.commands import execute; assert execute({}) == 0; "
REFUSED = RUN.replace("== 0", "== 2")
HEAVY = ("viser", "trimesh", "matplotlib", "aiohttp")
NUMERIC = ("pinocchio", "numba", "scipy")


@pytest.mark.parametrize(
    ("code", "not_needed"),
    [
        (RUN.format(["list"]), (*HEAVY, "numba", "scipy")),
        (RUN.format(["run", "planar2r-semicircle", "--duration", "0.01", "--out", "OUT"]), HEAVY),
        ("import app.gateway.serve; ", ("viser", *NUMERIC)),
        (REFUSED.format(["serve", "--shared", "--max-sessions", "0"]), ("viser", *NUMERIC)),
        ("import app.dashboard.page; ", ("matplotlib", "scipy.signal", "scipy.stats", "aiohttp")),
        ("import app.workers.preview; ", HEAVY),
        ("import app.workers.precompile; ", HEAVY),
    ],
    ids=["list", "run", "gateway", "server", "page", "preview", "precompile"],
)
def test_only_what_is_needed_is_loaded(code: str, not_needed: tuple[str, ...], tmp_path: Path) -> None:
    code = "import sys; " + code.replace("OUT", str(tmp_path)) + f"print([m for m in {not_needed} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_private_parts_of_viser_are_used_in_one_file() -> None:
    private = re.compile(r"viser\._|\b_websock_server\b|\._impl\b|_from_uuid\b|\b_live_connections\b")
    sources = (Path(__file__).parents[2] / "app").rglob("*.py")
    assert {file.name for file in sources if private.search(file.read_text())} == {"viser_private.py"}
