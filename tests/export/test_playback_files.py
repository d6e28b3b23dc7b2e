"""Playback of a run as one HTML file: its frames, its plots, and its limit."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from html import unescape

import msgspec
import numpy as np
import pytest
import zstandard

from app.dashboard.plots.charts import Setup
from app.dashboard.plots.paper_figures import figure_of, plots_of
from app.dashboard.scene.standalone import snapshots, standalone_html
from app.export.export_jobs import ExportJobs, PlaybackJob
from app.export.playback_frames import FRAMES_PER_SECOND, PlaybackFrames, playback_frames
from app.scenario.data import load
from app.session.snapshot import Snapshot, snapshot_of
from app.simulation.closed_loop import ClosedLoop
from app.storage.recording_files import TooLarge
from tests.support.svg import letters_of

pytestmark = pytest.mark.slow  # processes of its own

made = ExportJobs().made


def test_film_has_a_row_for_each_thirtieth_of_a_second(loop: ClosedLoop) -> None:
    shot = playback_frames(loop.system.scenario, loop.recording, 0.1, 0.9)
    assert len(shot) == round(0.8 * FRAMES_PER_SECOND) + 1
    np.testing.assert_allclose(np.diff(shot.signals["t"]), 1 / FRAMES_PER_SECOND, atol=1.01e-3)
    last = loop.recording.at(float(shot.signals["t"][-1]))
    np.testing.assert_array_equal(shot.signals["q"][-1], last["q"])


def test_film_shows_what_the_page_showed() -> None:
    loop = ClosedLoop.from_scenario(load("ur5-hybrid-moving"))
    for _ in range(700):
        loop.step()
    seen = snapshot_of(loop)
    loop.step()
    (frame,) = snapshots(playback_frames(loop.system.scenario, loop.recording, seen.t, seen.t))
    assert frame.t == seen.t
    assert np.linalg.norm(seen.force) > 1.0
    for name in ("q", "tool", "tool_desired", "force", "force_desired"):
        np.testing.assert_allclose(getattr(frame, name), getattr(seen, name), rtol=1e-9, atol=1e-12, err_msg=name)
    assert [each.form for each in frame.surfaces] == [each.form for each in seen.surfaces]


def messages_in(html: str) -> dict:
    """What viser's player reads from the page."""
    embedded = re.search(r'window.__VISER_EMBED_DATA__="([^"]*)"', html)
    assert embedded is not None
    packed = base64.b64decode(embedded[1])
    plain = zstandard.ZstdDecompressor().decompress(packed[8:], max_output_size=int.from_bytes(packed[:8], "little"))
    size = int.from_bytes(plain[:8], "little")
    return msgspec.msgpack.decode(plain[8 : 8 + size])


def test_playback_moves_arm_surface_and_force(loop: ClosedLoop) -> None:
    shot = playback_frames(loop.system.scenario, loop.recording)
    played = messages_in(made(PlaybackJob(shot, 25e6), lambda _: None).decode())
    assert played["durationSeconds"] == pytest.approx(shot.signals["t"][-1] + 1 / FRAMES_PER_SECOND)
    moved = {(m["name"], m["type"]) for t, m in played["messages"] if t > 0 and "name" in m}
    assert ("/surface", "SetPositionMessage") in moved
    assert any(name.startswith("/robot_1/") and kind == "SetOrientationMessage" for name, kind in moved)
    assert any(name == "/force/true" for name, _ in moved)
    heights = [(t, m["position"][2]) for t, m in played["messages"] if m.get("name") == "/surface" and "position" in m]
    surface = loop.system.surface.motion
    for t, height in heights[1:]:
        assert height == pytest.approx(surface.offset(t + shot.signals["t"][0])[2], abs=1e-3)


def test_playback_has_its_plots_beside_it(loop: ClosedLoop, snapshot: Snapshot) -> None:
    shot = playback_frames(loop.system.scenario, loop.recording, 0.2, 0.8)
    figure = figure_of(plots_of(["Overview", "Chattering"]), snapshot, Setup.of(snapshot, 0, 0), 0.2, 0.8)
    page = made(PlaybackJob(shot, 25e6, figure), lambda _: None).decode()
    aside = re.search(
        r'<aside id="vs-plots" data-begin="([\d.]+)" data-panels="([^"]*)">.*?(<svg.*?</svg>)', page, re.DOTALL
    )
    assert aside is not None
    assert float(aside[1]) == shot.signals["t"][0]
    panels = msgspec.json.decode(unescape(aside[2]))
    assert len(panels) == 5, "those over time: a spectrum has no instant"
    for panel in panels:
        assert panel["first"] == pytest.approx(0.2, abs=2e-3), "also of a variation, which begins 0.1 s later"
        assert panel["last"] == pytest.approx(0.8, abs=2e-3)
        assert 0 < panel["left"] < panel["right"] < 1
        assert 0 < panel["top"] < panel["bottom"] < 1
    assert "tracking error" in letters_of(aside[3].encode())
    assert page.count("</body>") == 1


def test_playback_over_its_limit_is_refused_with_what_fits(loop: ClosedLoop) -> None:
    shot = playback_frames(loop.system.scenario, loop.recording)
    many = {name: np.concatenate([values] * 12) for name, values in shot.signals.items()}
    many["t"] = np.arange(len(many["t"])) / FRAMES_PER_SECOND
    long = PlaybackFrames(shot.scenario, many)
    least = len(
        standalone_html(playback_frames(loop.system.scenario, loop.recording, 0.0, 0.0), np.inf, lambda _: None)
    )
    whole = len(standalone_html(long, np.inf, lambda _: None))
    with pytest.raises(TooLarge, match=r"which is about ([45678][.\d]*) s"):
        standalone_html(long, (least + whole) / 2, lambda _: None)
    with pytest.raises(TooLarge, match="the scene alone takes"):
        standalone_html(long, 1e5, lambda _: None)
    with pytest.raises(ValueError, match="nothing recorded"):
        standalone_html(replace(long, signals={k: v[:0] for k, v in many.items()}), 1e6, lambda _: None)
