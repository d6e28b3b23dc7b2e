"""The Export tab in a real browser: what its buttons hand over, and a scenario brought back."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from app.dashboard.page import Dashboard
from app.scenario.data import edited, from_toml, shipped, to_toml
from app.session.commands import Pause, Pin
from app.session.runner import Runner
from app.session.snapshot import Snapshot
from drivers.pages import PATIENCE, VIEWPORT, PageSession, type_over
from tests.support.svg import letters_of


def taken(session: PageSession, button: str, folder: Path) -> Path:
    """Click and wait for the file."""
    session.tab("Export")
    with session.page.expect_download() as download:
        session.page.get_by_role("button", name=button, exact=True).click()
    path = folder / download.value.suggested_filename
    download.value.save_as(path)
    return path


def test_figures_data_and_scenario_are_handed_over_and_the_run_goes_on(session: PageSession, tmp_path: Path):
    session.wait(lambda now: now.t > 1.0)
    before = session.now
    session.tab("Export")
    session.choose("Figure of", "Overview")  # all plots take their time
    height = session.page.get_by_label("Height [mm]")
    for given, sentence in (
        ("two", "height: 'two'; allowed: a number of mm"),
        ("9", "height: 9 mm; allowed: 20 to"),
    ):
        type_over(height, given)
        session.page.get_by_role("button", name="SVG", exact=True).click()
        session.page.get_by_text(sentence).wait_for()
    type_over(height, "321")
    svg = taken(session, "SVG", tmp_path).read_bytes()
    assert "tracking error" in letters_of(svg)
    assert "hybrid mode" in letters_of(svg)
    assert float(re.findall(r'height="([0-9.]+)pt"', svg.decode())[0]) == pytest.approx(321.0 / 25.4 * 72.0, rel=1e-4)
    assert session.now.phase == "running"
    assert session.now.t > before.t
    session.runner.post(Pause())
    session.wait(lambda now: now.phase == "paused")
    type_over(height, "")
    session.runner.post(Pin())
    session.wait(lambda now: len(now.pinned) == 1)
    beside = letters_of(taken(session, "SVG", tmp_path).read_bytes())
    assert beside.count(session.now.pinned[0].title) == 4  # in the legends of errors, force and ‖s‖, and in the caption
    session.choose("Figure of", "all plots")
    with np.load(taken(session, "NPZ", tmp_path)) as saved:
        rows = session.now.recording.signals(("q",), saved["t"][0], saved["t"][-1])
        np.testing.assert_array_equal(saved["q"], rows["q"])
    csv = taken(session, "CSV", tmp_path)
    assert csv.name.startswith("vsmrc-ur5-hybrid-")
    assert len(csv.read_text().splitlines()) > 1000
    assert from_toml(taken(session, "TOML", tmp_path).read_text()) == before.scenario
    assert (session.now.revision, session.now.run) == (before.revision, before.run)


def test_picture_and_playback_show_the_scene(
    session: PageSession, served: tuple[Dashboard, Runner], tmp_path: Path, open_page: Callable[..., Page]
):
    dashboard, content = served[0], served[0]._content
    assert content is not None
    session.wait(lambda now: now.t > 1.0)
    session.runner.post(Pause())
    session.page.evaluate("window.undrawn = false")

    def size() -> tuple[float, float]:
        canvas = session.page.locator("canvas[data-engine]").bounding_box()
        assert canvas is not None
        return canvas["width"], canvas["height"]

    def beside_docks(_: Snapshot) -> bool:
        """Whether the docks have taken their room from the scene, and the server knows."""
        known = [content._visible_parts.scene_of(client) for client in dashboard.clients]
        return size()[0] < VIEWPORT["width"] and known == [tuple(map(round, size()))]

    session.wait(beside_docks)
    picture = Image.open(taken(session, "2×", tmp_path))
    session.page.evaluate("window.undrawn = true")
    width, height = size()
    assert (picture.width, picture.height) == (2 * round(width), 2 * round(height))
    colours = picture.convert("RGB").getcolors(maxcolors=2**24)
    assert colours is not None
    assert len(colours) > 1000, "an arm and a surface in their light"
    file, title = taken(session, "HTML", tmp_path), session.now.scenario.title
    session.page.close()  # drawing two scenes in software is slow
    played = open_page(file.as_uri(), viewport=VIEWPORT)
    played.locator("canvas[data-engine]").wait_for(timeout=PATIENCE * 1e3)
    assert played.title() == title
    clock = played.locator("input.mantine-NumberInput-input")
    begun = float(clock.input_value(timeout=PATIENCE * 1e3))
    played.wait_for_function("document.querySelector('#vs-plots line').hasAttribute('x1')", timeout=PATIENCE * 1e3)
    at = played.locator("#vs-plots line").first.get_attribute("x1")
    played.wait_for_function(
        "at => document.querySelector('#vs-plots line').getAttribute('x1') !== at", arg=at, timeout=PATIENCE * 1e3
    )
    played.wait_for_function(
        "begun => Number(document.querySelector('input.mantine-NumberInput-input').value) !== begun",
        arg=begun,
        timeout=PATIENCE * 1e3,
    )


def test_a_scenario_is_loaded_and_a_wrong_one_refused(session: PageSession, tmp_path: Path):
    wanted = edited(edited(shipped()["ur5-motion"], "name", "mine"), "controller.layer", 0.02)
    (tmp_path / "mine.toml").write_text(to_toml(wanted))
    (tmp_path / "wrong.toml").write_text("mode = 'levitation'")
    session.tab("Export")
    load = session.page.locator("input[type=file][accept*='.toml']")
    load.set_input_files(tmp_path / "mine.toml")
    session.wait(lambda now: now.scenario == wanted and now.t > 0.2)
    revision = session.now.revision
    load.set_input_files(tmp_path / "wrong.toml")
    session.page.get_by_text("File uploaded successfully.").first.wait_for(state="attached")
    session.page.locator(".vs-message", has_text="wrong.toml: mode: 'levitation'; allowed:").wait_for()
    assert (session.now.revision, session.now.phase) == (revision, "running")
    expect(session.page.get_by_text("File uploaded successfully.").locator("visible=true")).to_have_count(0)


def test_a_failure_is_said_on_the_page_and_the_run_goes_on(
    session: PageSession, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "gone"))
    before = session.now
    session.tab("Export")
    session.page.get_by_role("button", name="SVG", exact=True).click()
    session.page.get_by_role("alert").filter(has_text="Figure: failed").get_by_text("No such file").wait_for()
    session.wait(lambda now: now.t > before.t + 0.3 and now.phase == "running")
