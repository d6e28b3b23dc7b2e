"""Large buttons over the scene: swap the law, push the tool, see s reach zero, take the way out of a refusal."""

from __future__ import annotations

from dataclasses import dataclass, replace
from html import escape

import numpy as np

from app.dashboard.widgets.controls import Desk
from app.session.changes import PUSH
from app.session.commands import Edit, PushNow, ShowAgain, TakeWayOut
from app.session.runner import SLOWEST
from app.session.snapshot import Snapshot
from controllers.control_law import ControlLaw
from controllers.laws.table import LAWS

_SHOWN_IN = 6.0  # s of wall time for the reaching phase
_LONGER = 1.5  # times the reaching time are shown
_WINDOWS = (0.5, 2.0)  # s, for the plots


class SceneButtons:
    """The buttons, each of which presses its key, and the commands of these keys."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._shown: _Shown | None = None
        self._html = desk.gui.add_html("")
        desk.gui.add_command("Swap the law: robust, or computed torque", hotkey="L").on_trigger(self._swap)
        desk.gui.add_command("Push the tool", hotkey="B").on_trigger(self._push)
        desk.gui.add_command("Take the way out of a refusal", hotkey="O").on_trigger(self._take_way_out)
        desk.gui.add_command("See s reach zero, in slow motion", hotkey="N").on_trigger(self._reach)

    async def _swap(self, _: object) -> None:
        self._desk.post(Edit("controller.law", _other(self._desk.snapshot().system.controller.law).kind))

    async def _push(self, _: object) -> None:
        self._desk.post(PushNow())

    async def _take_way_out(self, _: object) -> None:
        self._desk.post(TakeWayOut())

    async def _reach(self, _: object) -> None:
        snapshot = self._desk.snapshot()
        again = reaching(snapshot)
        if again is None:
            self._desk.complain("reaching: s has begun at zero; allowed: after an edit with z kept, see tab Controller")
            return
        viewing, long = self._desk.viewing, again.end - again.start
        usual = viewing.window if self._shown is None else self._shown.usual
        self._shown = _Shown(snapshot.run, again.end, usual)
        viewing.window = next((window for window in _WINDOWS if window >= long), viewing.window)
        self._desk.post(again)

    def show(self, snapshot: Snapshot) -> None:
        self._restore_window(snapshot)
        law, push = snapshot.system.controller.law, snapshot.scenario.truth.push
        force = sum(value**2 for value in (push if any(push) else PUSH)) ** 0.5
        content = (
            '<div class="vs-acts">'
            f"{_button('l', f'Try {_other(law).title}', f'now: {law.title}')}"
            f"{_button('b', f'Push with {force:.3g} N', 'or drag the ball at the tool')}"
        )
        if reaching(snapshot) is not None:
            content += _button("n", "See s reach zero", "in slow motion")
        if way := snapshot.way_out:
            note = "a way out of what was refused"
            content += _button("o", way.title, note, opens=".urdf" if way.asks_for_file else "")
        content += "</div>"
        if self._html.content != content:
            self._html.content = content

    def _restore_window(self, snapshot: Snapshot) -> None:
        """The plots' usual window again, when the stretch shown slowly is over or another run has begun."""
        shown = self._shown
        if shown is None:
            return
        begun = shown.begun or snapshot.t <= shown.end
        if snapshot.run != shown.run or (begun and snapshot.t > shown.end):
            self._desk.viewing.window, self._shown = shown.usual, None
        else:
            self._shown = replace(shown, begun=begun)


@dataclass(frozen=True)
class _Shown:
    """The stretch for which the plots have a window of their own.
    run: number of the run.
    end: s, its last instant.
    usual: s, the window afterwards.
    begun: whether a snapshot of it has been seen; until then those of the instant of the command still come."""

    run: int
    end: float
    usual: float
    begun: bool = False


def reaching(snapshot: Snapshot) -> ShowAgain | None:
    """Command that shows the last reaching phase slowly; None where s began at zero, nothing was to be reached, or the
    run is no longer known as far back."""
    epoch, period = snapshot.state.epoch, snapshot.scenario.controller.period
    if not snapshot.system.controller.law.robust or not epoch.certificate.t_r > 10.0 * period:
        return None
    if epoch.t < snapshot.first:
        return None
    reached = epoch.reached if epoch.reached is not None else epoch.banded
    took = epoch.certificate.t_r if reached is None else reached - epoch.t
    long = _LONGER * max(took, 10.0 * period)
    return ShowAgain(epoch.t, epoch.t + long, float(np.clip(long / _SHOWN_IN, SLOWEST, 1.0)))


def _other(law: ControlLaw) -> ControlLaw:
    """The first law of the table that is robust where this one is not, and the other way round."""
    return next(each for each in LAWS.values() if each.robust != law.robust)


def _button(key: str, does: str, note: str, opens: str = "") -> str:
    """Button that presses a key, as HTML.
    opens: ending of the files that it asks for instead, as the panel's upload button does."""
    presses = f'data-upload="{opens}"' if opens else f'data-key="{key}"'
    return (
        f'<button {presses} title="{escape(does)} ({key.upper()})"><b>{escape(does)}</b> '
        f"<kbd>{key.upper()}</kbd><small>{escape(note)}</small></button>"
    )
