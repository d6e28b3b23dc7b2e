"""Ticks of the timeline."""

from __future__ import annotations

from itertools import pairwise

from app.analysis.run_events import Event
from app.dashboard.widgets.playback import APART, apart


def test_many_events_of_a_kind_leave_ticks_that_stand_apart_and_the_last_one_and_all_rare_ones() -> None:
    pushes = [(Event(float(k), "push", "pushed"), k / 200) for k in range(201)]
    fork = (Event(100.2, "fork", "forked"), 0.501)
    kept = apart(sorted([*pushes, fork], key=lambda place: place[1]))
    assert fork in kept
    assert kept[-1] == pushes[-1]
    shares = [share for event, share in kept if event.kind == "push"]
    assert 30 < len(shares) <= 41
    assert all(b - a > APART - 1e-9 for a, b in pairwise(shares))
    assert apart(pushes[:1]) == pushes[:1]
