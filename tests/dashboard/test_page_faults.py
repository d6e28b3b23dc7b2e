"""Faults of the page, one at a time: the run goes on, others are served, and what is held is let go."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from app.dashboard.page import Dashboard
from app.dashboard.transport.stalled_clients import StalledClients
from app.dashboard.widgets.run import playback
from app.scenario.data import load
from app.session.commands import Edit, SetSpeed
from app.session.runner import Runner
from app.session.snapshot import PREPARING
from drivers.waiting import PATIENCE, until
from tests.gateway.test_gateway import ask
from tests.support.drawn import drawn
from tests.support.faults import Client, begun, boom, running, warp
from tests.support.viser_insides import buffer_of, chosen, widget_labelled, widgets_of

pytestmark = pytest.mark.slow  # servers


@pytest.fixture(scope="module")
def runner() -> Iterator[Runner]:
    with running() as runner:
        yield runner


@dataclass(frozen=True)
class Server:
    dashboard: Dashboard
    runner: Runner

    def open(self, *, reads: bool = True) -> Client:
        return Client(self.dashboard.port, lambda: set(self.dashboard.clients), reads=reads)

    def status_text(self) -> str:
        """What the status line shows."""
        return self.dashboard._content._status.content if self.dashboard._content is not None else ""


@pytest.fixture(scope="module")
def server(runner: Runner) -> Iterator[Server]:
    with drawn(Dashboard(runner, port=0, fps=10.0)) as dashboard:
        yield Server(dashboard, runner)


def drag(phase: str, to: np.ndarray, modifier: str | None = None) -> dict[str, Any]:
    point = [float(x) for x in to]
    return {
        "type": "SceneNodeDragMessage", "phase": phase, "name": "/hand/handle", "instance_index": None,
        "start_position": point, "start_screen_pos": [0.5, 0.5], "end_position": point, "end_screen_pos": [0.5, 0.5],
        "button": "left", "modifier": modifier, "owner": "",
    }  # fmt: skip


def test_a_loop_that_hangs_is_said_and_is_not_healthy(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    """While its thread hangs, the page is drawn and answers; what runs again is healthy again."""
    begun(server.runner, load("ur5-hybrid"))
    page = server.open()
    healthy = (200, "ok\n")

    def health() -> tuple[int, str]:
        return ask(server.dashboard.port, "/healthz")[::2]

    assert health() == healthy
    goes_on, advance = threading.Event(), server.runner._advance

    def hanging(*arguments: Any) -> None:
        goes_on.wait(PATIENCE)
        advance(*arguments)

    try:
        with monkeypatch.context() as patched:
            patched.setattr("app.session.runner.SILENCE", 0.5)
            patched.setattr(server.runner, "_advance", hanging)
            until(lambda: "no sign of life" in server.status_text())
            status, sentence = health()
            assert (status, sentence.partition(" for ")[0]) == (503, "The loop has given no sign of life")
            # an arm that is being prepared takes its time, but not for ever
            patched.setattr(server.runner, "_newest", replace(server.runner.snapshot, notice=PREPARING))
            assert health() == healthy
            patched.setattr("app.session.runner.PREPARATION", 0.5)
            assert health()[0] == 503
    finally:
        goes_on.set()
    until(lambda: health() == healthy)
    until(lambda: "no sign of life" not in server.status_text())
    page.vanish()
    until(lambda: not server.dashboard.clients)


def test_a_page_that_vanishes_lets_go_of_the_tool_and_leaves_the_target(server: Server) -> None:
    before = begun(server.runner, load("ur5-impedance"))
    page = server.open()
    page.send(drag("start", before.tool))
    page.send(drag("update", before.tool + np.array([0.0, 0.05, 0.0])))
    until(lambda: server.runner.snapshot.state.grip is not None)
    page.vanish()
    until(lambda: server.runner.snapshot.state.grip is None)
    page = server.open()
    hand = server.dashboard._content._hand  # pyright: ignore[reportOptionalMemberAccess]
    page.send(drag("start", before.tool, "shift"))
    page.send(drag("update", before.tool + np.array([0.0, 0.05, 0.0]), "shift"))
    until(lambda: hand._held is not None and hand._held.moved.any())
    page.vanish()
    until(lambda: hand._held is None and not server.dashboard.clients)
    server.runner.post(Edit("force.value", 21.0))  # whatever the page posted comes before it
    until(lambda: server.runner.snapshot.scenario.force.value == 21.0)  # pyright: ignore[reportAttributeAccessIssue]
    assert server.runner.snapshot.scenario.shift == before.scenario.shift


def test_a_page_that_vanishes_with_a_slider_held_ends_the_preview(server: Server) -> None:
    before = begun(server.runner, load("ur5-hybrid"))
    view = server.dashboard._content
    assert view is not None
    widgets = list(widgets_of(view._server).values())
    slider = widgets[widgets.index(widget_labelled(view._server, "F_d [N]")) + 1]
    page, other = server.open(), server.open()
    positions = itertools.cycle((0.7, 0.6))

    def held() -> bool:  # a page that is not drawn yet knows of no run, and holds nothing
        if view._whatif.held is None:
            page.send(chosen(slider, next(positions)))
        return view._whatif.held is not None and view._whatif.preview is not None

    until(held, lambda: (view._whatif.held, view._whatif.refusal))
    page.vanish()
    until(lambda: view._whatif.held is None and view._whatif.preview is None)
    until(lambda: view._previewer.idle)
    assert server.runner.snapshot.scenario == before.scenario
    other.vanish()


def test_a_client_that_does_not_read_is_dropped_and_bounded_meanwhile(server: Server) -> None:
    begun(server.runner, load("ur5-hybrid"))
    reading, stuck = server.open(), server.open(reads=False)
    stalled_clients = StalledClients(server.dashboard._server, patience=2.0)
    # something that fills every buffer on the way, also when it is compressed
    filling = np.random.default_rng(0).bytes(20_000_000)
    server.dashboard.clients[stuck.number].send_file_download("file", filling)
    until(lambda: stalled_clients._sizes().get(stuck.number, 0) > 20_000)
    buffer = buffer_of(server.dashboard._server)

    def grown_over_200_messages() -> int:
        kept, counter = len(buffer.message_from_id), buffer.message_counter
        until(lambda: buffer.message_counter > counter + 200)
        return len(buffer.message_from_id) - kept

    until(lambda: grown_over_200_messages() < 50)  # of each kind the newest, once there was one of each
    until(lambda: stalled_clients.drop() or stuck.number not in server.dashboard.clients)
    assert reading.number in server.dashboard.clients
    reading.vanish()


@pytest.mark.faults
def test_a_page_that_cannot_be_drawn_says_so_and_the_run_goes_on(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = begun(server.runner, load("ur5-hybrid"))
    view, client = server.dashboard._content, server.open()
    assert view is not None
    with monkeypatch.context() as patched:
        patched.setattr(view._plots, "show", boom)
        until(
            lambda: "the page could not be drawn (KeyError: &#x27;boom&#x27;); the run goes on" in server.status_text()
        )
    until(lambda: view._drawn is not None and view._drawn.t > before.t + 1.0)
    client.vanish()


def test_drawing_that_hangs_for_seconds_costs_the_run_nothing(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    before = begun(server.runner, load("ur5-hybrid"))
    view, client = server.dashboard._content, server.open()
    assert view is not None
    hangs, goes_on = threading.Event(), threading.Event()

    def hanging(*_: object) -> None:
        hangs.set()
        goes_on.wait()

    with monkeypatch.context() as patched:
        patched.setattr(view._playback, "show", hanging)
        assert hangs.wait(PATIENCE)
        now = until(lambda: server.runner.snapshot.t > before.t + 3.0 and server.runner.snapshot)
        t = now.recording.signals(("t",))["t"]
        assert np.allclose(np.diff(t), now.scenario.controller.period)  # no control step is missing
        client.send(chosen(widget_labelled(view._server, "Speed"), "1/2×"))
        until(lambda: server.runner.snapshot.speed == 0.5)  # it is heard meanwhile
        goes_on.set()
        server.runner.post(SetSpeed(1.0))
    until(lambda: view._drawn is not None and view._drawn.t > now.t)
    client.vanish()


@pytest.mark.faults
def test_a_callback_that_fails_is_said_on_the_page(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    before = begun(server.runner, load("ur5-hybrid"))
    view, client = server.dashboard._content, server.open()
    assert view is not None
    with monkeypatch.context() as patched:
        patched.setattr(view._hand, "_drag", boom)  # which viser calls one after the other
        client.send(drag("start", before.tool))
        until(
            lambda: "could not carry that out (KeyError: &#x27;boom&#x27;)" in server.status_text(), server.status_text
        )
    speed = widget_labelled(view._server, "Speed")
    choice = chosen(speed, "2×")
    with monkeypatch.context() as patched:
        patched.setattr(playback, "SetSpeed", warp)
        client.send(choice)  # as a task
        until(lambda: "could not carry that out (ValueError: warp)" in server.status_text(), server.status_text)
    until(lambda: speed.value == "1×")  # the menu shows the running speed again: before, the same choice is no change
    client._connection.send(b"\x93garbage")
    client.send(choice)
    until(lambda: server.runner.snapshot.speed == 2.0)
    until(lambda: server.runner.snapshot.t > before.t + 0.1)
