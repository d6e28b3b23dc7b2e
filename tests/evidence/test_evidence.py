"""The command that writes docs/evidence.md, and the page that is committed."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from app.cli.figures import figures
from app.evidence.drawing import HeatMap, charts_in_columns, heat_maps
from app.evidence.make import make
from app.evidence.section import EvidenceSection, Findings, Job
from app.evidence.sections import SECTIONS
from app.export.figures import Curve, FigureChart
from app.process.markdown import Table
from app.scenario.data import edited, load
from app.scenario.errors import ScenarioError
from app.session.headless_run import simulate
from app.simulation.engines import Engine
from drivers.waiting import until

pytestmark = pytest.mark.slow  # processes of its own

ROOT = Path(__file__).parents[2]


def test_numbers_tables_and_figures_are_on_the_page(tmp_path: Path) -> None:
    """The jobs run elsewhere and come back in their order."""

    def conclude(results: Sequence[object]) -> Findings:
        assert results == [7, 3]
        tables = {name: Table(("T",), [("0.97",)]) for name in ("plant", "loop", "band")}
        numbers: dict[str, str] = dict.fromkeys(("loop_slopes", "band_slopes"), "0.98 to 1.02")
        return Findings(numbers, tables, {"orders": b"<svg/>"})

    section = EvidenceSection("convergence", lambda thin: [Job(abs, (n,)) for n in (-7, 3)[::thin]], conclude)
    page = make([section], 1, tmp_path, workers=2).read_text(encoding="utf-8")
    assert (tmp_path / "evidence" / "convergence-orders.svg").read_bytes() == b"<svg/>"
    assert "](evidence/convergence-orders.svg)" in page
    assert page.count("| 0.97 |") == 3
    assert page.count("0.98 to 1.02") == 2


def engine_of_a_run(scenario: str) -> str:
    return simulate(edited(load(scenario), "simulation.duration", 0.01))[1].engine


@pytest.mark.parametrize("engine", get_args(Engine))
def test_runs_are_played_by_the_engine_that_is_asked_for(tmp_path: Path, engine: Engine) -> None:
    found: list[object] = []

    def conclude(results: Sequence[object]) -> Findings:
        found.extend(results)
        return Findings(dict.fromkeys(("plant", "loop", "band", "loop_slopes", "band_slopes"), ""), {}, {"orders": b""})

    section = EvidenceSection("convergence", lambda _: [Job(engine_of_a_run, ("ur5-hybrid",))], conclude)
    page = make([section], 1, tmp_path, workers=1, engine=engine).read_text(encoding="utf-8")
    assert found == [engine]
    assert (f"--engine {engine}" in page) == (engine != "pinocchio")


def test_what_a_section_lacks_is_said(tmp_path: Path) -> None:
    section = EvidenceSection(
        "convergence", lambda thin: [Job(abs, (thin,))], lambda results: Findings({"plant": str(results)})
    )
    with pytest.raises(KeyError, match=r"orders_figure"):
        make([section], 1, tmp_path, workers=1)
    needy = replace(section, needs={"no_such_module": "pip install no-such-module"})
    page = make([needy], 1, tmp_path, workers=1).read_text(encoding="utf-8")
    assert "*Not run here; it needs pip install no-such-module.*" in page


def test_what_cannot_be_made_is_refused_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="--only fable: allowed: paper_cases, theorem, closed_forms"):
        figures(out=tmp_path, only=("fable",))
    with pytest.raises(ScenarioError, match="--thin 0: allowed: 1 or more"):
        figures(out=tmp_path, thin=0)
    (tmp_path / "file").write_text("")
    with pytest.raises(ScenarioError, match=r"--out .*file: is a file; allowed: a folder"):
        figures(out=tmp_path / "file", only=("paper_cases",))


def test_the_workers_end_when_the_command_is_killed(tmp_path: Path) -> None:
    """Also by a signal that nothing can catch."""
    command = [sys.executable, "-m", "app", "figures", "--only", "paper_cases", "--out", str(tmp_path)]
    process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    try:
        while not (workers := [pid for pid in children.read_text().split() if _is_worker(pid)]):
            assert process.poll() is None
            time.sleep(0.05)
    finally:
        process.kill()
        process.wait()
    until(lambda: not any(map(_is_worker, workers)))


def _is_worker(pid: str) -> bool:
    try:
        return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except FileNotFoundError:
        return False


def words_of(svg: str) -> str:
    return " ".join(re.findall(r"<text[^>]*>(.*?)</text>", svg, flags=re.DOTALL))


def test_no_figure_shows_markup_as_text() -> None:
    """Neither what is drawn now, maps as well as charts, over few and many decades, nor what is committed."""
    words = ("error", "N", "delay [ms]", "low-pass [Hz]", ("1", "2"), ("a", "b"))
    maps = [
        HeatMap(*words, np.array([[low, 1.0], [2.0, high]]), (low, high), 1.0)
        for low, high in ((0.01, 100.0), (1e-4, 2.0), (10.0, 1e5), (0.5, 8.0))
    ]
    x = np.geomspace(1e-6, 1e4, 50)
    curve = Curve("one", (10, 20, 30), x, x)
    charts = [FigureChart("of x", "m", (curve,), logarithmic=log, logarithmic_x=not log) for log in (True, False)]
    drawn = [*(heat_maps([each], "caption") for each in maps), charts_in_columns(charts, "caption")]
    drawn += [path.read_bytes() for path in (ROOT / "docs" / "evidence").glob("*.svg")]
    for svg in drawn:
        words = words_of(svg.decode())
        assert words
        assert not set("$\\") & set(words)
    assert {"0.01", "0.1", "1", "10", "100"} <= set(words_of(drawn[0].decode()).split())


def test_charts_of_the_evidence_stand_in_two_columns() -> None:
    curve, sizes = Curve("one", (10, 20, 30), np.arange(5.0), np.arange(5.0)), []
    for count in (1, 2, 3, 4):
        svg = charts_in_columns([FigureChart("of x", "m", (curve,))] * count, "caption").decode()
        found = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', svg)
        assert found is not None
        sizes.append((float(found[1]), float(found[2])))
    (alone, _), (beside, low), (_, high), (_, full) = sizes
    assert beside > 1.9 * alone
    assert low < high == full


def test_the_committed_page_has_every_section_whole() -> None:
    page = (ROOT / "docs" / "evidence.md").read_text(encoding="utf-8")
    assert [section.heading for section in SECTIONS] == re.findall(r"^## .*", page, flags=re.MULTILINE)
    assert "of the cases only" not in page
    assert "Not run here" not in page
    pictures = re.findall(r"\]\((evidence/[\w-]+\.svg)\)", page)
    assert sorted(pictures) == sorted(f"evidence/{path.name}" for path in (ROOT / "docs" / "evidence").glob("*.svg"))
