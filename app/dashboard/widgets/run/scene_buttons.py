"""Large buttons over the scene: swap the law, push the tool, show how s reaches zero, take the way out of a refusal."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from html import escape

import numpy as np

from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.fields.edit_lock import EditLock
from app.scenario.data import differences
from app.session.changes import pushed
from app.session.commanded_run import SLOWEST
from app.session.commands import Edit, EditAll, PushNow, ShowAgain, TakeWayOut
from app.session.snapshot import Snapshot
from app.session.ways_out import WayOut
from controllers.control_law import ControlLaw
from controllers.laws.table import LAWS

_SHOWN_IN = 6.0  # s of wall time in which the reaching phase is shown
_LONGER = 1.5  # shown time over the reaching time
_WINDOWS = (0.5, 2.0)  # s, windows of the plots meanwhile


class SceneButtons:
    """Large buttons, each of which presses a key, and the commands of these keys."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._shown: _Shown | None = None
        self._html = desk.gui.add_html("")
        desk.gui.add_command("Swap the law: robust, or computed torque", hotkey="L").on_trigger(self._swap)
        desk.gui.add_command("Push the tool", hotkey="B").on_trigger(self._push)
        desk.gui.add_command("Accept the fix of a refusal", hotkey="O").on_trigger(self._take_way_out)
        desk.gui.add_command("See s reach zero, in slow motion", hotkey="N").on_trigger(self._reach)

    async def _swap(self, _: object) -> None:
        self._desk.post(Edit("controller.law", _other(self._desk.snapshot().system.controller.law).kind))

    async def _push(self, _: object) -> None:
        self._desk.post(PushNow())

    async def _take_way_out(self, _: object) -> None:
        snapshot, lock = self._desk.snapshot(), self._desk.lock
        way = snapshot.way_out
        if lock.fields is None or way is None or way.scenario is None or not _admitted(lock, way, snapshot):
            self._desk.post(TakeWayOut())  # which the lock refuses where it is closed
        elif changes := differences(snapshot.scenario, way.scenario):
            self._desk.post(EditAll({path: new for path, (_, new) in changes.items()}))

    async def _reach(self, _: object) -> None:
        snapshot = self._desk.snapshot()
        again = reaching(snapshot)
        if again is None:
            self._desk.complain(f"reaching phase: {_unseen(snapshot)}")
            return
        viewing, long = self._desk.viewing, again.end - again.start
        usual = viewing.window if self._shown is None else self._shown.usual
        viewing.window = next((window for window in _WINDOWS if window >= long), viewing.window)
        self._shown = _Shown(snapshot.run, again.end, usual, viewing.window)
        self._desk.post(again)

    def show(self, snapshot: Snapshot) -> None:
        self._restore_window(snapshot)
        law = snapshot.system.controller.law
        content = (
            '<div class="vs-acts" data-live>'
            f"{_button('l', f'Try {_other(law).title}', f'now: {law.title}')}"
            f"{_button('b', push_title(snapshot), 'or drag the ball at the tool')}"
        )
        if reaching(snapshot) is not None:
            content += _button("n", "See s reach zero", "in slow motion")
        if (way := snapshot.way_out) and _admitted(self._desk.lock, way, snapshot):
            note = "a fix of what was refused"
            content += _button("o", way.title, note, opens=".urdf" if way.asks_for_file else "")
        content += "</div>"
        if self._html.content != content:
            self._html.content = content

    def _restore_window(self, snapshot: Snapshot) -> None:
        """Give the plots their usual window again, when the slow stretch is over or another run has begun."""
        shown = self._shown
        if shown is None:
            return
        begun = shown.begun or snapshot.t <= shown.end
        if snapshot.run != shown.run or (begun and snapshot.t > shown.end):
            if self._desk.viewing.window == shown.window:  # nobody has chosen another one meanwhile
                self._desk.viewing.window = shown.usual
            self._shown = None
        else:
            self._shown = replace(shown, begun=begun)


def _admitted(lock: EditLock, way: WayOut, snapshot: Snapshot) -> bool:
    """Whether a way out changes no field that a lesson locks."""
    if lock.fields is None:
        return True
    return way.scenario is not None and differences(snapshot.scenario, way.scenario).keys() <= lock.fields


@dataclass(frozen=True)
class _Shown:
    """Stretch of a run that is shown slowly, with another window of the plots.
    run: number of the run.
    end: s, last instant of the stretch.
    usual: s, window of the plots afterwards; window: s, meanwhile.
    begun: whether a snapshot of the stretch has come; earlier ones are later in the run."""

    run: int
    end: float
    usual: float
    window: float
    begun: bool = False


def push_title(snapshot: Snapshot) -> str:
    """Title of the button that pushes, with the push that it would begin."""
    truth = pushed(snapshot.scenario, snapshot.system.robot, snapshot.t).truth
    sizes = [(math.hypot(*truth.push), "N"), (math.hypot(*truth.push_moment), "N·m")]
    sizes_text = " and ".join(f"{size:.3g} {unit}" for size, unit in sizes if size)
    return f"{'Push' if sizes[0][0] else 'Turn'} with {sizes_text}"


def reaching(snapshot: Snapshot) -> ShowAgain | None:
    """Command that shows the last reaching phase slowly; None where the law has none, s began near zero, or the
    recording does not go back so far."""
    epoch, period = snapshot.state.epoch, snapshot.scenario.controller.period
    if not snapshot.system.controller.law.robust or not epoch.certificate.t_r > 10.0 * period:
        return None
    if epoch.t < snapshot.first:
        return None
    reached = epoch.layer_reached if epoch.layer_reached is not None else epoch.band_reached
    took = epoch.certificate.t_r if reached is None else reached - epoch.t
    long = _LONGER * max(took, 10.0 * period)
    return ShowAgain(epoch.t, epoch.t + long, float(np.clip(long / _SHOWN_IN, SLOWEST, 1.0)))


def _unseen(snapshot: Snapshot) -> str:
    """Reason why there is no reaching phase to see, and what allows it."""
    if not snapshot.system.controller.law.robust:
        return "the law in force has no s; allowed: under the robust law (key L)"
    if snapshot.state.epoch.t < snapshot.first:
        return "its beginning is no longer recorded; allowed: after an edit, or a reset (R)"
    return "s began at zero, so there is nothing to see; allowed: after an edit that keeps z, see tab Controller"


def _other(law: ControlLaw) -> ControlLaw:
    """Law to swap for: the first robust one of the table for a law that is not robust, else the first other one."""
    return next(each for each in LAWS.values() if each.robust != law.robust)


def _button(key: str, does: str, note: str, opens: str = "") -> str:
    """Button that presses a key, as HTML.
    does, note: title and text of the button.
    opens: file extension for a button that asks for a file instead, as the panel's upload button does."""
    presses = f'data-upload="{opens}"' if opens else f'data-key="{key}"'
    return (
        f'<button {presses} title="{escape(does)} ({key.upper()})"><b>{escape(does)}</b> '
        f"<kbd>{key.upper()}</kbd><small>{escape(note)}</small></button>"
    )
