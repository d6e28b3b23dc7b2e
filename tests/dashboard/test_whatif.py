"""What if: from which state a held slider's preview goes on, and what the panel says of it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

from app.dashboard.widgets.run.whatif import OPENING, HeldControl, WhatIf
from app.dashboard.widgets.run.whatif_panel import body_html
from app.scenario.data import edited, shipped
from app.session.commands import DragTool, Edit, Reset, Seek
from app.session.preview import PreviewRun
from app.session.preview_client import Previewer
from app.session.preview_messages import Preview, PreviewRequest
from app.session.runner import Runner
from app.simulation.closed_loop import ClosedLoop
from app.simulation.state import State
from environments.push import Grip


def test_a_preview_of_a_past_instant_goes_on_without_the_hand_as_its_edit_would() -> None:
    asked: list[State] = []

    def ask(state: State, *_: Any, **__: Any) -> None:
        asked.append(state)

    runner, edit = Runner(shipped()["planar2r-semicircle"]), Edit("controller.layer", 0.02)
    whatif = WhatIf(
        cast(Previewer, SimpleNamespace(ask=ask, newest=None, failure="", idle=True, drop=lambda: None, warm_up=print))
    )
    runner._obey([DragTool(Grip((0.5, 0.0, 0.3)))])
    for _ in range(50):
        runner._commanded.step()
    whatif.look(runner._publish(), (), 0.0)  # which run it is
    whatif.hold(HeldControl(edit, "layer", "0.02", object(), 1, runner._publish().run))
    whatif.look(runner._publish(), (1,), 0.0)
    assert asked[-1].grip is not None
    runner._obey([Seek(0.02)])
    past = runner._publish()
    assert past.looking_back
    whatif.look(past, (1,), 0.0)
    assert asked[-1].grip is None
    assert asked[-1].t == past.t
    runner._obey([edit])
    assert runner._loop.grip is None


def test_the_process_for_previews_is_started_once_a_run_and_not_while_the_first_page_opens() -> None:
    warmed: list[State] = []
    whatif = WhatIf(cast(Previewer, SimpleNamespace(newest=None, failure="", idle=True, warm_up=warmed.append)))
    runner = Runner(shipped()["planar2r-semicircle"])
    for now, started in ((100.0, 0), (100.0 + OPENING, 0), (100.1 + OPENING, 1), (200.0, 1)):
        whatif.look(runner._publish(), (1,), now)
        assert len(warmed) == started, now
    runner._obey([Reset()])
    whatif.look(runner._publish(), (1,), 200.1)
    assert len(warmed) == 2


def test_the_panel_says_of_which_seconds_it_tells_and_whether_a_layer_or_the_band_is_reached() -> None:
    loop = ClosedLoop.from_scenario(shipped()["ur5-hybrid"])
    for _ in range(20):
        loop.step()
    for path, value, which, reached in (
        ("force.value", 25.0, "within the next 0.1 s", "layer reached after"),
        ("task_space.characteristic_length", 0.2, "within the first 0.1 s", "layer reached after"),
        ("controller.switching", "discontinuous", "within the next 0.1 s", "band reached after"),
    ):
        preview_run = PreviewRun(
            PreviewRequest(1, loop.state.copy(), edited(loop.system.scenario, path, value), 0.1), loop.system
        )
        preview_run.advance(1000)
        preview = preview_run.preview()
        assert isinstance(preview, Preview)
        html = body_html(cast(WhatIf, SimpleNamespace(preview=preview, refusal="")), loop.system.units)
        assert which in html
        assert ("both columns are of a run from its beginning" in html) == preview.restarts == ("first" in which)
        assert reached in html
