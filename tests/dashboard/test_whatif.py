"""What if: from which state a held slider's preview goes on."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

from app.dashboard.widgets.whatif import HeldControl, WhatIf
from app.scenario.data import shipped
from app.session.commands import Edit, Push, Seek
from app.session.preview_client import Previewer
from app.session.runner import Runner
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
    runner._obey([Push(Grip((0.5, 0.0, 0.3)))])
    for _ in range(50):
        runner._commanded.step()
    whatif.look(runner._publish(), ())  # which run it is
    whatif.hold(HeldControl(edit, "layer", "0.02", object(), 1))
    whatif.look(runner._publish(), (1,))
    assert asked[-1].grip is not None
    runner._obey([Seek(0.02)])
    past = runner._publish()
    assert past.looking_back
    whatif.look(past, (1,))
    assert asked[-1].grip is None
    assert asked[-1].t == past.t
    runner._obey([edit])
    assert runner._loop.grip is None
