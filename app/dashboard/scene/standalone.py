"""Playback of the 3-D view as an HTML page that needs no server: viser's player with the messages of every frame."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from dataclasses import replace
from html import escape
from importlib import resources

import msgspec
import numpy as np
import viser
from viser.infra import StateSerializer

from app.access.admission import Names
from app.dashboard.scene.view import SceneView
from app.dashboard.transport.handshake import behind_doors
from app.dashboard.transport.message_filter import MessageFilter
from app.dashboard.view_options import SceneOptions
from app.export.figures import SINGLE, Figure, FigureOptions
from app.export.playback_frames import FRAMES_PER_SECOND, PlaybackFrames
from app.export.printing import svg_with_panels
from app.process.redaction import new_secret
from app.session.snapshot import Snapshot, snapshot_of
from app.simulation.closed_loop import ClosedLoop
from app.simulation.system import System
from app.storage.constants_store import kept_memory
from app.storage.link_meshes import link_meshes
from app.storage.recording_files import ProgressCallback, TooLarge

PATHS_EVERY = 3  # frames, as on the page


def standalone_html(
    frames: PlaybackFrames, limit: float, on_progress: ProgressCallback, figure: Figure | None = None
) -> str:
    """HTML page that plays the frames, with a figure beside the scene. limit: its largest size, bytes. Raises
    ValueError where there is no frame, and TooLarge.

    A viser server at a free port of this machine makes the messages.
    """
    if not len(frames):
        raise ValueError("playback: nothing recorded there")
    html = _html(frames, len(frames), on_progress)
    if figure is not None:
        html = html.replace("</body>", f"{plots_html(figure, float(frames.signals['t'][0]))}</body>", 1)
    if (size := len(html)) > limit:
        raise TooLarge(_too_large(frames, size, limit))
    return html


def _too_large(frames: PlaybackFrames, size: float, limit: float) -> str:
    seconds = len(frames) / FRAMES_PER_SECOND
    still = len(_html(frames, 1, lambda _: None))
    sizes = f"{seconds:.3g} s of playback make {size / 1e6:.3g} MB; allowed: {limit / 1e6:.3g} MB"
    if still > limit:
        return f"{sizes}, and the scene alone takes {still / 1e6:.3g} MB"
    return f"{sizes}, which is about {seconds * (limit - still) / (size - still):.3g} s"


def _html(frames: PlaybackFrames, count: int, on_progress: ProgressCallback) -> str:
    """HTML page with the first `count` frames."""
    times = frames.signals["t"][:count]
    pauses = [*np.diff(times), 1.0 / FRAMES_PER_SECOND]
    with _server() as server:
        scene, options = SceneView(server), SceneOptions()
        recorder: StateSerializer | None = None
        for number, (snapshot, pause) in enumerate(zip(snapshots(frames), pauses, strict=False)):
            if recorder is None and not snapshot.robot.shipped:
                link_meshes(snapshot.robot).result()  # the playback shows the whole arm from its first frame on
            scene.show(snapshot, options)
            if number % PATHS_EVERY == 0:
                scene.draw_paths(options)
            if recorder is None:  # only now, so that the recording starts with the scene of the first frame
                recorder = server.get_scene_serializer()
            recorder.insert_sleep(float(pause))
            on_progress(0.9 * (number + 1) / count)
        assert recorder is not None
        title = escape(frames.scenario.title or frames.scenario.name)
        return recorder.as_html(dark_mode=True).replace("<title>Viser</title>", f"<title>{title}</title>")


def plots_html(figure: Figure, begin: float) -> str:
    """HTML of the figure, with a line at the instant that is played. begin: first instant of the playback, s."""
    drawn = svg_with_panels(figure, FigureOptions(width=SINGLE, caption=False))
    svg = drawn.svg[drawn.svg.index(b"<svg") :].decode()
    panels = msgspec.json.encode(drawn.panels).decode()
    files = resources.files("static").joinpath("playback")
    sheet, script = (files.joinpath(name).read_text(encoding="utf-8") for name in ("plots.css", "plots.js"))
    return (
        f"<style>{sheet}</style>"
        f'<aside id="vs-plots" data-begin="{begin}" data-panels="{escape(panels)}"><button>Plots</button>{svg}</aside>'
        f"<script>{script}</script>"
    )


@contextlib.contextmanager
def _server() -> Iterator[viser.ViserServer]:
    with contextlib.redirect_stdout(io.StringIO()):  # viser would print its address, which is of no use here
        with behind_doors(Names(), new_secret()):  # as nobody has the key, nobody can open the server's page
            server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        MessageFilter(server, complain=lambda _: None)  # nobody sees this page
        try:
            yield server
        finally:
            server.stop()


def snapshots(frames: PlaybackFrames) -> Iterator[Snapshot]:
    """Snapshots of the frames, with no more than the 3-D view shows."""
    loop = ClosedLoop.from_scenario(frames.scenario, history=1, memory=kept_memory())
    system, start = loop.system, snapshot_of(loop)
    for number in range(len(frames)):
        yield _at(start, system, {name: values[number] for name, values in frames.signals.items()})


def _at(start: Snapshot, system: System, row: dict[str, np.ndarray]) -> Snapshot:
    t = float(row["t"])
    _, task = system.observe(row["q"], row["q_dot"], t)
    reference = system.reference(t)._replace(r_d=row["r_d"])
    return replace(
        start,
        t=t,
        q=row["q"],
        tool=row["tool"],
        tool_desired=None if system.layout.joint else system.tool_at(reference.r_d, t),
        force=row["F_true"],
        force_desired=row["F_cd"][: system.pressed] @ task.normals[: system.pressed],
    )
