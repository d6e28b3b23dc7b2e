"""Ticks of the timeline."""

from __future__ import annotations

from itertools import pairwise

from app.analysis.run_events import Event
from app.dashboard.widgets.playback import APART, apart


def test_many_events_of_a_kind_leave_ticks_that_stand_apart_and_the_last_one_and_all_rare_ones() -> None:
    pushes = [(Event(float(k), "push", "pushed"), k / 200) for k in range(201)]
    fork = (Event(100.2, "fork", "forked"), 0.501)
    kept = apart(sorted([*pushes, fork], key=lambda place: place[1]))
    assert fork in [tick[:2] for tick in kept]
    assert kept[-1][:2] == pushes[-1]
    shares = [share for event, share, _ in kept if event.kind == "push"]
    assert 30 < len(shares) <= 41
    assert all(b - a > APART - 1e-9 for a, b in pairwise(shares))
    assert [tick[:2] for tick in apart(pushes[:1])] == pushes[:1]


def test_a_tick_tells_of_the_nearer_ones_before_it_in_the_pages_words() -> None:
    laws = [
        (Event(80.0, "edit", "controller.law = computed-torque", (("controller.law", "computed-torque"),)), 0.600),
        (Event(83.4, "edit", "controller.law = vsmrc", (("controller.law", "vsmrc"), ("contact.K_e", 2e4))), 0.601),
    ]
    (tick,) = apart(laws)
    assert tick.event.t == 83.4
    first, second = tick.told.splitlines()
    assert first.startswith("80.00 s: ")
    assert "computed torque" in first
    assert second.endswith("20000 N/m")
    assert "contact.K_e" not in tick.told
