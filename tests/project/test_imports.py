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


# each in one process: what is loaded stays so, and nothing is needed at a stage that a later one must not have
# app.workers.session serves the page, and app.workers.fork_server loads it before it is asked for one
STAGES = {
    "program": {
        RUN.format(["list"]): (*HEAVY, "numba", "scipy"),
        "import app.workers.precompile; ": HEAVY,
        "import app.workers.preview; ": HEAVY,
        "import app.workers.sweep, app.workers.export; ": HEAVY,
        RUN.format(["run", "planar2r-semicircle", "--duration", "0.01", "--out", "OUT"]): HEAVY,
        "import app.dashboard.page; ": ("trimesh", "matplotlib", "scipy.signal", "scipy.stats", "aiohttp"),
    },
    "meshes": {
        "import app.workers.link_meshes; ": ("viser", "matplotlib", "aiohttp", "numba"),
    },
    "gateway": {
        "import app.gateway.serve; ": ("viser", *NUMERIC),
        REFUSED.format(["serve", "--shared", "--max-sessions", "0"]): ("viser", *NUMERIC),
    },
}


@pytest.mark.parametrize("stages", STAGES.values(), ids=STAGES)
def test_only_what_is_needed_is_loaded(stages: dict[str, tuple[str, ...]], tmp_path: Path) -> None:
    code = "import sys; "
    for stage, not_needed in stages.items():
        code += stage.replace("OUT", str(tmp_path))
        code += f"loaded = [m for m in {not_needed} if m in sys.modules]; assert not loaded, loaded; "
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_private_parts_of_viser_are_used_in_one_file_of_the_program_and_one_of_its_tests() -> None:
    private = re.compile(r"viser\._(?!_)|\b_websock_server\b|\._impl\b|_from_uuid\b|\b_live_connections\b")
    for folder, one in (("app", "dashboard/transport/viser_private.py"), ("tests", "support/viser_insides.py")):
        root = Path(__file__).parents[2] / folder
        found = {file.relative_to(root).as_posix() for file in root.rglob("*.py") if private.search(file.read_text())}
        assert found - {"project/test_imports.py"} == {one}
