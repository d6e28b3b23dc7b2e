"""Two large buttons over the scene: swap the control law, and push the tool."""

from __future__ import annotations

from html import escape

from app.dashboard.widgets.controls import Desk
from app.session.changes import PUSH
from app.session.commands import Edit, PushNow
from app.session.snapshot import Snapshot
from controllers.control_law import ControlLaw
from controllers.laws.table import LAWS


class SceneButtons:
    """The buttons, each of which presses its key, and the commands of these keys."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._html = desk.gui.add_html("")
        desk.gui.add_command("Swap the law: robust, or computed torque", hotkey="L").on_trigger(self._swap)
        desk.gui.add_command("Push the tool", hotkey="B").on_trigger(self._push)

    async def _swap(self, _: object) -> None:
        self._desk.post(Edit("controller.law", _other(self._desk.snapshot().system.controller.law).kind))

    async def _push(self, _: object) -> None:
        self._desk.post(PushNow())

    def show(self, snapshot: Snapshot) -> None:
        law, push = snapshot.system.controller.law, snapshot.scenario.truth.push
        force = sum(value**2 for value in (push if any(push) else PUSH)) ** 0.5
        content = (
            '<div class="vs-acts">'
            f"{_button('l', f'Try {_other(law).title}', f'now: {law.title}')}"
            f"{_button('b', f'Push with {force:.3g} N', 'or drag the ball at the tool')}</div>"
        )
        if self._html.content != content:
            self._html.content = content


def _other(law: ControlLaw) -> ControlLaw:
    """The first law of the table that is robust where this one is not, and the other way round."""
    return next(each for each in LAWS.values() if each.robust != law.robust)


def _button(key: str, does: str, note: str) -> str:
    return (
        f'<button data-key="{key}" title="{escape(does)} ({key.upper()})"><b>{escape(does)}</b> '
        f"<kbd>{key.upper()}</kbd><small>{escape(note)}</small></button>"
    )
