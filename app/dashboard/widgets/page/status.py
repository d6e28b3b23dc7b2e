"""Status line: the scenario, its time and speed, and the verdict on the theorem's promise."""

from __future__ import annotations

from html import escape

import numpy as np

from app.dashboard.widgets.chips import ChipClass, chip, verdict_now
from app.lessons.words import ENGLISH, LessonWords
from app.scenario.caption import title_of
from app.scenario.schema import Scenario
from app.session.pacing import Pace
from app.session.snapshot import Snapshot
from app.simulation.promise.verdict import Standing
from controllers.modes import MODES

_LATELY = 0.2  # s before now in which a cut torque is still reported


def status_html(
    snapshot: Snapshot, complaint: str, begun_from: Scenario | None = None, words: LessonWords = ENGLISH
) -> str:
    """Status line as HTML: chips and numbers, and a strip over the scene, which moves no other widget, with the reason
    of a stop, the complaint and the notice.
    begun_from: the shipped scenario of the running one's name, None for none.
    words: of the lesson that is open."""
    scenario = snapshot.scenario
    pace = None if snapshot.preparing else snapshot.pace  # it stands still meanwhile
    lines = [
        '<div class="vs-row"><span class="vs-title" role="heading" aria-level="1">'
        f"{_title(scenario, begun_from)}</span></div>",
        '<div class="vs-row">'
        f"{chip(MODES[scenario.mode].label, 'vs-mode')}{_phase(snapshot)}"
        f'<span class="vs-right"><span class="vs-dim">t</span> <b class="vs-number">{snapshot.t:.2f}</b> s</span>'
        "</div>",
        '<div class="vs-row">'
        f"{_verdict(snapshot.standing)}"
        f'<span class="vs-right vs-pace" title="{_pace_title(pace)}"><span class="vs-dim">real time</span> '
        f'<b class="vs-number">{f"{snapshot.realtime_factor:.2f}×" if pace else "—"}</b></span></div>',
        _reason(snapshot),
    ]
    messages = []
    if snapshot.phase == "stopped":
        messages.append(_message("vs-bad", f"{words.stopped.format(snapshot.reason)}. {words.goes_on}"))
    if pace and pace.slowed:
        messages.append(_message("vs-warn", _slowed(snapshot)))
    if complaint:
        messages.append(_message("vs-bad", complaint))
    if snapshot.notice:
        messages.append(_message("vs-warn", snapshot.notice + _over(snapshot)))
    strip = f'<div class="vs-strip" role="status">{"".join(messages)}</div>'
    return f'<div class="vs-status" data-live data-phase="{snapshot.phase}">{"".join(lines)}{strip}</div>'


def _over(snapshot: Snapshot) -> str:
    """Words behind a warning whose cause is over; "" where it is not, or where the notice is no warning."""
    promise, flag = snapshot.standing.promise_record, snapshot.state.flagged
    if flag is None or snapshot.notice != str(flag) or snapshot.standing.now.verdict != "holds":
        return ""
    # contact that is lost on an elastic surface leaves the promise as it was
    return f"; all premises hold again since t = {promise.since:.3f} s" if promise.since > flag.t else ""


def _title(scenario: Scenario, begun_from: Scenario | None) -> str:
    """Title as HTML, with a word when the user has edited the scenario since."""
    title = title_of(scenario, begun_from)
    return f'{escape(title.text)} <span class="vs-dim">edited</span>' if title.edited else escape(title.text)


def splash_html(text: str) -> str:
    """Content of the page while there is no run yet."""
    return f'<div class="vs-splash"><span class="vs-spinner"></span>{escape(text)}</div>'


def _phase(snapshot: Snapshot) -> str:
    if snapshot.preparing:
        return chip("preparing", "vs-warn")
    if snapshot.looking_back:
        return chip("shown again" if snapshot.phase == "running" else "looking back", "vs-warn")
    looks: dict[str, ChipClass] = {"running": "vs-good", "paused": "vs-warn", "stopped": "vs-bad"}
    return chip(snapshot.phase, looks[snapshot.phase])


def _verdict(standing: Standing) -> str:
    """Verdict on the theorem's promise, as HTML."""
    words, look = verdict_now(standing)
    text = {"holds": "promise holds", "broken": "promise broken"}.get(words, words)
    return f'<span title="{escape(standing.now.because)}">{chip(text, look)}</span>'


def _reason(snapshot: Snapshot) -> str:
    """Line with the reason of the verdict in a few words; it is always there, so that nothing below it jumps."""
    why, whole = snapshot.standing.reason, snapshot.standing.now.because
    if saturating := _saturating(snapshot):
        why = saturating
    elif violated := snapshot.standing.outsiders:
        why, whole = "true arm outside the declared set", "; ".join(violated)
    return f'<div class="vs-dim vs-why" title="{escape(whole)}">{escape(why)}</div>'


def _saturating(snapshot: Snapshot) -> str:
    """Joints whose torque was cut by a drive's limit in the last `_LATELY` s, as text; "" where there are none."""
    rows = snapshot.recording.signals(("tau", "tau_applied"), snapshot.t - _LATELY, snapshot.t)
    joints = np.flatnonzero((rows["tau"] != rows["tau_applied"]).any(axis=0)) + 1
    return f"torque at its limit: joint {', '.join(map(str, joints))}" if len(joints) else ""


def _pace_title(pace: Pace | None) -> str:
    if pace is None:
        return ""
    return (
        f"{pace.achieved:.0f} of {pace.requested:.0f} control steps per second; "
        f"late by {pace.late_median * 1e3:.2f} ms (median), at most {pace.late_most * 1e3:.1f} ms"
    )


def _slowed(snapshot: Snapshot) -> str:
    return (
        f"The loop cannot keep up: {snapshot.speed:g}× asked for, {snapshot.realtime_factor:.3g}× reached. "
        "Simulated time is slowed; no control step is skipped."
    )


def _message(chip_class: str, text: str) -> str:
    return f'<div class="vs-message {chip_class}">{escape(text)}</div>'
