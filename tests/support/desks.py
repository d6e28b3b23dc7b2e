"""Desk of a page without a runner: for widgets that ask for something and are answered."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import viser

from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.run.whatif import WhatIf
from app.scenario.schema import Scenario
from app.session.commands import Command
from app.session.preview_client import Previewer
from app.session.snapshot import Snapshot, snapshot_of
from app.simulation.closed_loop import ClosedLoop


class Posted(list[Command]):
    """Commands in the order in which they were posted."""

    def post(self, command: Command) -> int:
        """Keep a command. Returns its number, from 1 on, as a runner does."""
        self.append(command)
        return len(self)


class BareDesk:
    """Desk with the widgets of a server of viser, at the start of a run that stands still.
    posted, complaints: what the widgets have asked for, and said."""

    def __init__(self, server: viser.ViserServer, scenario: Scenario) -> None:
        self.posted = Posted()
        self.complaints: list[str] = []
        self.whatif = WhatIf(Previewer())
        self._snapshot = snapshot_of(ClosedLoop.from_scenario(scenario))
        self.desk = cast(
            Desk,
            SimpleNamespace(
                gui=server.gui, snapshot=self.snapshot, post=self.posted.post, complain=self.complaints.append,
                withdraw_complaint=lambda: None,
                whatif=self.whatif, background_jobs=SimpleNamespace(allowance="a core"),
            ),
        )  # fmt: skip

    def snapshot(self) -> Snapshot:
        return self._snapshot
