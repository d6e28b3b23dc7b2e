"""Names that try to be markup: of arms, joints, links, scenarios, files, formulas, wherever the page shows them."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Iterator
from html import escape
from pathlib import Path

import pytest

from app.dashboard.export import ExportedStretch, FigureChoice, write
from app.dashboard.page import Dashboard
from app.export.export_jobs import file_name
from app.scenario.data import edited, from_plain, load, shipped, to_plain
from app.scenario.schema import Scenario
from app.session.commands import Edit, Load, Pin
from app.session.headless_run import simulate
from app.session.runner import Runner
from drivers.waiting import until
from tests.support.viser_insides import buffer_of

pytestmark = pytest.mark.slow  # processes of its own

EVIL = '<img src=x onerror="window.hacked=1">'
BENT = (Path(__file__).parents[1] / "support" / "robots" / "bent3r.urdf").read_text(encoding="utf-8")


def evil_arm(folder: Path) -> Path:
    """bent3r with joints and links that are called like an attack, each in its own way."""
    text = BENT
    for name in ("turn", "shoulder", "elbow", "upper", "fore", "flange", "tip"):
        text = text.replace(f'"{name}"', f'"{escape(f"{EVIL}{name}")}"')
    path = folder / f"{EVIL.replace('/', '')}.urdf"
    path.write_text(text, encoding="utf-8")
    return path


def evil_scenario(folder: Path, kind: str) -> Scenario:
    plain = to_plain(load("ur5-motion")) | {"name": EVIL, "title": f"{EVIL} $\\frac{{$"}
    plain["robot"] = {"name": "ur5", "urdf": str(evil_arm(folder))}
    plain["task_space"] = {"kind": kind}
    plain["motion"] = {"kind": "hold"}
    return from_plain(plain)


@pytest.fixture
def shown() -> Iterator[tuple[Dashboard, Runner]]:
    """A dashboard that a test draws itself."""
    runner = Runner(shipped()["ur5-hybrid"])
    dashboard = Dashboard(runner, port=0)
    runner.start()
    yield dashboard, runner
    dashboard.close()
    runner.close()


def until_answered(runner: Runner, answers: tuple[int, int]) -> None:
    until(lambda: (runner.snapshot.revision, runner.snapshot.refusal_number) != answers)


def markup(dashboard: Dashboard) -> list[str]:
    """All HTML and Markdown that a page is sent."""
    sent = []
    for message in list(buffer_of(dashboard._server).message_from_id.values()):
        props = getattr(message, "props", None)
        sent += [getattr(props, name, "") for name in ("content", "_markdown", "_icon_html")]
        sent += [text for name, text in getattr(message, "updates", {}).items() if name in ("content", "_markdown")]
    return [text for text in sent if isinstance(text, str)]


def test_names_are_text_wherever_the_page_shows_them(shown: tuple[Dashboard, Runner], tmp_path: Path) -> None:
    dashboard, runner = shown
    view = dashboard._content
    assert view is not None
    refused = (Edit("robot.tool_frame", EVIL), Edit("robot.urdf", f"/{EVIL}"), Edit("robot.name", EVIL))
    for scenario in (evil_scenario(tmp_path, "cartesian"), evil_scenario(tmp_path, "joint")):
        for command in (Load(scenario), Pin(), Edit("truth.payload_mass", 1.0), *refused):
            answers = runner.snapshot.revision, runner.snapshot.refusal_number
            runner.post(command)
            if not isinstance(command, Pin):
                until_answered(runner, answers)
            view._plots_due = view._refreshed = 0.0
            view.draw(time.monotonic())
        assert runner.snapshot.scenario.title == scenario.title, runner.snapshot.refusal
    pages = markup(dashboard)
    assert not [page for page in pages if "<img src=x" in page]
    assert any(escape(EVIL) in page for page in pages)


def test_files_that_are_taken_away(tmp_path: Path) -> None:
    """Figures and data of such a run; no name of a file has a separator or a line's end in it."""
    scenario = edited(evil_scenario(tmp_path, "joint"), "simulation.duration", 0.05)
    loop, _ = simulate(scenario, show_progress=False)
    out = tmp_path / "out"
    stretch = ExportedStretch(scenario, loop.recording, 0.0, 0.05)
    svg, csv = (path.read_text(encoding="utf-8") for path in write(stretch, ("svg", "csv"), FigureChoice(), out))
    assert "<img" not in svg
    words = "".join(re.sub(r"<[^>]*>", "", svg).split())  # a line may break within, a letter may be set as a symbol
    assert escape(EVIL, quote=False).replace(" ", "") in words
    assert all(line.startswith("#") for line in csv.splitlines() if "onerror" in line or "\x1b" in line)
    for name in ("a\r\nContent-Type: text/html", "../../etc/passwd", 'a"; rm', EVIL, "\u202ecsv.exe"):
        assert set('/\\\r\n"<>;\u202e').isdisjoint(file_name(name, 1.0, "csv"))


def test_a_terminal_gets_no_escape_sequences() -> None:
    arguments = ("run", "ur5-motion", "--out", "x", "--set", "robot.urdf=\x1b]0;owned\x07\n")
    done = subprocess.run([sys.executable, "-m", "app", *arguments], capture_output=True, timeout=300)
    assert done.returncode == 2
    assert done.stderr.startswith(b"vsmrc: ")
    assert not {0x1B, 0x07} & set(done.stderr + done.stdout)
    assert done.stderr.count(b"\n") == 1
