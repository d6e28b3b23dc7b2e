"""Benchmark of a session's computations in the background: pace of the running loop while a map fills in, and while
better gains are searched for."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec

from app.process.markdown import Table
from app.scenario.data import edited, shipped
from app.sweep.axes import axis_of
from app.sweep.background import Background, BackgroundSweep
from app.sweep.background_jobs import allowance_of
from app.sweep.fingerprint import fingerprint
from app.sweep.plan import Sweep
from app.tune.background import BackgroundTuning
from app.tune.plan import Tuning, moved, program
from benchmarks.effort import Effort
from benchmarks.watched_page import WatchedPage, watched_page

SCENARIO, DURATION = "ur5-hybrid", 3.0  # s, of a run
TILES = 60  # along each side of the map, for each process: more than it computes meanwhile
GAINS, AIMS = ("controller.layer=0.002:0.05:log", "controller.K_s=20:400:log"), ("force_error", "torque_variation")


def measure(effort: Effort) -> Table:
    """Table of paces."""
    workers = allowance_of(shared=False).workers
    scenario = edited(shipped()[SCENARIO], "simulation.duration", DURATION)
    axes = f"contact.K_e=1e3:1e5:{TILES * workers}:log", f"truth.link_scaling=0.85:1.15:{TILES}"
    sweep = Sweep(scenario, tuple(map(axis_of, axes)), program=fingerprint())
    tuning = Tuning(scenario, tuple(map(moved, GAINS)), draw=8, points=1000 * workers, aims=AIMS)
    tuning = msgspec.structs.replace(tuning, program=program(tuning))
    with watched_page(SCENARIO) as page:
        rows = [("nothing", *_row(page, effort.pacing, None, lambda: ()))]
        filling = BackgroundSweep(sweep, workers)
        rows.append(("a map", *_row(page, effort.pacing, filling, lambda: filling.rows)))
        searching = BackgroundTuning(tuning, workers)
        rows.append(("a search for better gains", *_row(page, effort.pacing, searching, lambda: searching.rows)))
    titles = ("real-time factor", "late p50, ms", "p99, ms", "max, ms", "runs per s")
    return Table((f"in the background, for {effort.pacing:.0f} s, in {workers} process(es)", *titles), rows)


def _row(
    page: WatchedPage, seconds: float, work: Background | None, results: Callable[[], Sequence[object]]
) -> tuple[str, ...]:
    """Cells of a row; the computation has begun before, and is ended. Raises RuntimeError where it ended by itself."""
    while work is not None and work.going and not results():  # its processes start
        page.watch(1.0)
    before = len(results())
    pace, _ = page.watch(seconds)
    computed = len(results()) - before
    if work is not None:
        if not work.going:
            raise RuntimeError(work.problem or f"the {work.noun} was too short")
        work.cancel()
        while work.going:
            page.watch(0.1)
    rate = "" if work is None else f"{computed / seconds:.0f}"
    return f"{pace.rate:.3f}", f"{pace.late_median:.2f}", f"{pace.late_p99:.2f}", f"{pace.late_worst:.2f}", rate
