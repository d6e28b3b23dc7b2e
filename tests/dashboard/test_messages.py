"""What is sent to a page: what has changed, and nothing else; and what is offered there."""

from __future__ import annotations

import asyncio
import math
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from html import escape
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import viser

from app.dashboard.page import Dashboard
from app.dashboard.scene.trails import PIECE, PIECES, SPACING, Trail
from app.dashboard.transport.visible_parts import AWAY, VisibleParts, takes_part
from app.dashboard.widgets.fields.edit_lock import EditLock
from app.dashboard.widgets.page.last_session import LastSession, add_last_session
from app.dashboard.widgets.run.scene_buttons import reaching
from app.scenario.data import load, shipped
from app.scenario.errors import ScenarioError
from app.session.autosave import Offer
from app.session.commands import Edit, Reset, ToEnd
from app.session.runner import Runner
from app.session.snapshot import snapshot_of
from tests.support.viser_insides import buffer_of, text_field_stand_in


@pytest.fixture(scope="module")
def dashboard() -> Iterator[Dashboard]:
    dashboard = Dashboard(port=0)
    yield dashboard
    dashboard.close()


def sent(server: viser.ViserServer) -> int:
    """Number of messages to all pages so far."""
    return buffer_of(server).message_counter


def test_a_run_at_rest_sends_nothing_and_a_moving_one_does(dashboard: Dashboard) -> None:
    runner = Runner(load("ur5-hybrid"))
    dashboard.attach(runner)
    view = dashboard._content
    assert view is not None
    frames = iter(range(1000))

    def frame() -> int:
        """Number of messages of a frame that shows everything anew."""
        view._controls_due = view._symbols._due = -math.inf
        before = sent(dashboard._server)
        view.draw(1e9 + next(frames))
        return sent(dashboard._server) - before

    for _ in range(3):
        frame()
    assert [frame() for _ in range(3)] == [0, 0, 0]
    for _ in range(50):
        runner._commanded.step()
    runner._newest = runner._publish()
    assert frame() > 10
    assert frame() == 0


@pytest.mark.parametrize("name", list(shipped()))
def test_every_shipped_scenario_is_shown_under_its_title_without_a_complaint(dashboard: Dashboard, name: str) -> None:
    scenario = load(name)
    runner = Runner(scenario)
    dashboard.attach(runner)
    view = dashboard._content
    assert view is not None
    for steps in (0, 50):
        for _ in range(steps):
            runner._commanded.step()
        runner._newest = runner._publish()
        view._controls_due = view._symbols._due = -math.inf
        view.draw(1e9 + steps)
        status = view._status.content
        assert f">{escape(scenario.title)}</span>" in status
        assert '"vs-message vs-bad"' not in status
    runner.close()


def test_of_a_path_only_the_newest_piece_is_sent(dashboard: Dashboard) -> None:
    trail = Trail(dashboard._server.scene, "/test_trail", (1, 2, 3), 1.0)
    assert {piece._line.colors.shape for piece in trail._pieces} == {(PIECE, 2, 3)}  # else pages draw it white later
    points = 2.0 * SPACING * np.arange(PIECES * PIECE + 20)[:, None] * [1.0, 0.0, 0.0]
    for point in points:
        trail.extend(point)
    trail.draw(shown=True, largest=None)
    before = sent(dashboard._server)
    trail.extend(points[-1] + [0.0, 1.0, 0.0])
    trail.draw(shown=True, largest=None)
    assert sent(dashboard._server) == before + 1
    # one line without gaps, to the newest point
    drawn = np.concatenate([piece._line.points[: len(piece.points) - 1] for piece in trail._pieces])
    np.testing.assert_array_equal(drawn[1:, 0], drawn[:-1, 1])
    np.testing.assert_allclose(drawn[-1], [points[-1], points[-1] + [0.0, 1.0, 0.0]], rtol=1e-6)
    assert (PIECES - 1) * PIECE < len(drawn) <= PIECES * PIECE


def test_the_reaching_phase_is_offered_where_there_is_one() -> None:
    none = Runner(load("ur5-motion")).snapshot
    assert reaching(none) is None
    runner = Runner(load("ur5-hybrid-reaching"))
    for _ in range(700):
        runner._commanded.step()
    snapshot = snapshot_of(runner._loop)
    again, epoch = reaching(replace(snapshot, first=0.0)), snapshot.state.epoch
    assert again is not None
    assert epoch.layer_reached is not None
    # the whole of it, until s is within the layer, in some seconds
    assert again.start == 0.0
    assert epoch.layer_reached < again.end < 2.0 * epoch.layer_reached
    assert 3.0 < (again.end - again.start) / again.factor < 10.0
    # no longer, when the recording begins after it
    assert reaching(replace(snapshot, first=0.2)) is None


def test_the_plots_have_a_window_of_their_own_until_the_reaching_phase_has_been_shown(dashboard: Dashboard) -> None:
    runner = Runner(load("ur5-hybrid-reaching"))
    dashboard.attach(runner)
    view = dashboard._content
    assert view is not None
    for _ in range(700):
        runner._commanded.step()
    runner._newest = runner._publish()
    buttons, viewing = view._scene_buttons, view._viewing
    usual = viewing.window

    def shown() -> float:
        buttons.show(runner._newest)
        return viewing.window

    asyncio.run(buttons._reach(None))
    short = shown()  # before the runner has gone back
    assert short < usual
    runner._obey(runner._queued())
    runner._newest = runner._publish()
    assert runner._newest.t == 0.0
    assert shown() == short
    runner._obey([ToEnd()])
    runner._newest = runner._publish()
    assert shown() == usual
    # another run ends it, too
    asyncio.run(buttons._reach(None))
    runner._obey([*runner._queued(), Reset()])
    runner._newest = runner._publish()
    assert shown() == usual


def test_any_thread_may_send_while_others_wait_for_messages(dashboard: Dashboard) -> None:
    """Without the mending of viser's events the sender fails with "deque mutated during iteration"."""
    server = dashboard._server
    buffer = buffer_of(server)
    woken = 0

    async def wait() -> None:
        nonlocal woken
        while True:
            await buffer.message_event.wait()
            buffer.message_event.clear()
            woken += 1

    async def wait_together() -> None:
        await asyncio.gather(*(wait() for _ in range(50)))

    waiting = asyncio.run_coroutine_threadsafe(wait_together(), server.get_event_loop())
    often = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        number = server.gui.add_number("sent", 0)
        for value in range(1, 20_001):
            number.value = value
    finally:
        sys.setswitchinterval(often)
        waiting.cancel()
    assert woken > 50


def test_a_complaint_stays_while_an_edit_from_before_it_is_carried_out(dashboard: Dashboard) -> None:
    runner = Runner(load("ur5-hybrid"))
    dashboard.attach(runner)
    view = dashboard._content
    assert view is not None
    frames = iter(range(1000))

    def shown(force: float) -> bool:
        """Whether the complaint is shown once this edit has been carried out."""
        view.draw(time.monotonic() + next(frames))
        runner._obey(runner._queued())
        runner._newest = runner._publish()
        assert runner.snapshot.scenario.force.value == force
        view.draw(time.monotonic() + next(frames))
        return "no such thing" in view._status.content

    runner.post(Edit("force.value", 30.0))
    view._complaint.refuse("no such thing")
    assert shown(30.0)
    runner.post(Edit("force.value", 40.0))
    assert not shown(40.0)


def test_unknown_tab_names_reported_by_a_page_are_ignored() -> None:
    tabs = VisibleParts()
    tabs.marker_html("Some plots")
    tabs.panel_marker_html("controls: some")
    field = text_field_stand_in()
    gui = SimpleNamespace(add_html=lambda _: None, add_text=lambda *_: field)
    tabs.add_field(cast(viser.GuiApi, gui))
    event = SimpleNamespace(client=SimpleNamespace(client_id=3))
    for number in range(100):
        field.value = f"Some plots,invented {number},controls: some,#500x400#{number}"
        asyncio.run(field.callbacks[0](event))
    assert tabs.tabs([3]) == {"Some plots", "controls: some"}
    assert (tabs.reports("Some plots"), len(tabs._reports)) == (100, 2)
    field.value = f"{AWAY}#500x400#1"
    asyncio.run(field.callbacks[0](event))
    assert tabs.all_away([3])


def test_plots_are_fitted_to_the_lowest_scene_of_the_pages_that_are_open() -> None:
    tabs, field = VisibleParts(), text_field_stand_in()
    tabs.add_field(cast(viser.GuiApi, SimpleNamespace(add_html=lambda _: None, add_text=lambda *_: field)))
    sizes = {1: "1280x720", 2: "1920x1080", 3: "390x287", 4: "", 5: "1e3x5", 6: "-5x-5", 7: "999999x1", 8: "0x0"}
    for client, size in sizes.items():
        field.value = f"Some plots#{size}#0.5"
        asyncio.run(field.callbacks[0](SimpleNamespace(client=SimpleNamespace(client_id=client))))
    assert tabs.scene_height([*sizes]) == 720
    assert tabs.scene_height([2, 3, 4, 5, 6, 7, 8]) == 1080
    tabs.tabs([1, 3])  # the second one has gone
    assert tabs.scene_height([*sizes]) == 720
    assert tabs.scene_height([3]) == tabs.scene_height([]) == 0


@pytest.mark.parametrize(
    ("width", "height", "takes"),
    # a desktop before and after its docks are there, small windows, phones, and a page that has not said its size
    [(1280, 720, True), (476, 720, True), (408, 600, True), (390, 287, False), (320, 193, False), (0, 0, False)],
)
def test_phones_take_no_part_in_how_high_the_plots_are(width: int, height: int, takes: bool) -> None:
    assert takes_part(width, height) == takes


class Widget(SimpleNamespace):
    """Stand-in for a widget of viser, and for the context that a folder is."""

    def on_click(self, click: Any) -> None:
        self.click = click

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        pass


@pytest.mark.faults
def test_a_last_session_that_cannot_be_read_stays_offered_and_is_answered_once() -> None:
    made: list[Widget] = []

    def widget(content: str, **_: object) -> Widget:
        made.append(Widget(content=content, visible=True))
        return made[-1]

    gui = cast(viser.GuiApi, SimpleNamespace(add_folder=widget, add_html=widget, add_button=widget))
    offer = cast(Offer, SimpleNamespace(runs=(), saved=0.0, scenario=load("ur5-hybrid")))
    page, complaints, done = SimpleNamespace(client=object()), list[str](), list[object]()
    during: list[Any] = [ScenarioError("no room"), ValueError("boom"), None]

    def take_up(_: Offer) -> tuple[tuple[()], str]:
        assert "reading" in text.content
        dismiss.click(page)  # comes while it is read
        if (fault := during.pop(0)) is not None:
            raise fault
        return (), ""

    session = LastSession(offer, "", take_up, lambda: done.append("refused"))
    lock = EditLock(lambda command: done.append(command) or len(done), complaints.append)
    add_last_session(gui, session, 0.0, lock, complaints.append)
    folder, text, go_on, dismiss = made
    offered = text.content
    lock.fields = frozenset({"target_model.B_m"})
    go_on.click(page)
    assert complaints.pop() == "the last session: locked by the goal of a lesson; allowed: leave the lesson"
    lock.fields = None
    for sentence in ("cannot be continued now: no room", "ValueError: boom"):
        go_on.click(page)
        assert sentence in complaints[-1]
        assert text.content == offered
        assert all(each.visible for each in (folder, go_on, dismiss))
    go_on.click(page)
    dismiss.click(page)
    assert not folder.visible
    assert [type(each).__name__ for each in done] == ["Continue"]
