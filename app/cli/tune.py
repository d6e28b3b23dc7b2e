"""Command `vsmrc tune`: searches for better gains."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import tyro

from app.cli.options import (
    Settings,
    configured,
    folder_of,
    require_until,
    require_workers,
    settings_of,
    written_to,
)
from app.cli.status import DONE
from app.cli.tables import show_table
from app.scenario.errors import ScenarioError

if TYPE_CHECKING:
    from app.tune.question import Tuning


def tune(
    scenario: Annotated[str, tyro.conf.Positional],
    /,
    *,
    move: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    aims: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(name="for", metavar="METRIC")] = (),
    draw: int = 0,
    budget: int = 120,
    unseen: int = 32,
    seed: int = 0,
    out: Path | None = None,
    duration: float | None = None,
    until: float | None = None,
    workers: int | None = None,
    dry_run: bool = False,
    settings: Settings = (),
) -> int:
    """Search for better gains of a scenario, judged by the worst of many true arms, and try them on arms that the
    search has not seen; the same command goes on where it was stopped.

    Args:
        scenario: a shipped scenario or a .toml file, whose gains are to be beaten
        move: gain that may move, PATH=LOW:HIGH, with :log behind where its logarithm is to be drawn evenly
        aims: metric that counts, the smaller the better (docs/tuning.md); two give a front
        draw: true arms drawn inside the declared set, the same for every candidate; 0: the scenario's own one
        budget: candidates besides the scenario's own gains
        unseen: further true arms, on which the own gains and those that are offered are compared
        seed: of arms and search: the same seed gives the same answer, with any number of processes
        out: folder for the runs, the scenarios that are offered, and a figure
        duration: simulated time of each run in s, instead of the scenario's
        until: when each run ends, s, before its duration, for which its constants are computed all the same
        workers: processes, instead of one for each core
        dry_run: only say what it would take
    """
    from app.sweep.question import require_not_drawn
    from app.tune import question, running

    for name, given, least in (("draw", draw, 0), ("budget", budget, 1), ("unseen", unseen, 1), ("seed", seed, 0)):
        if given < least:
            raise ScenarioError(f"--{name} {given}; allowed: {least} or more")
    if seed > question.LARGEST_SEED:
        raise ScenarioError(f"--seed {seed}; allowed: at most {question.LARGEST_SEED}")
    require_workers(workers)
    require_until(until)
    asked = question.Tuning(
        scenario=configured(scenario, settings, duration),
        vary=tuple(map(question.moved, move)),
        points=budget + 1,
        draw=draw,
        seed=seed,
        until=until or 0.0,
        aims=aims,
        unseen=unseen,
    )
    asked = msgspec.structs.replace(asked, program=question.program(asked))
    require_not_drawn(asked, dict(settings_of(settings)))
    question.require_sound(asked)
    if dry_run:
        print(f"at most {running.estimated(asked, running.most_runs(asked), workers)}")
        return DONE
    return _tune_into(folder_of("tune", out), asked, workers)


def _tune_into(out: Path, asked: Tuning, workers: int | None) -> int:
    from app.sweep.run_store import RunStore
    from app.tune import outcome, running

    with written_to(out, "; what is there stays"), RunStore(out, asked) as store:
        if done := int(store.done.sum()):
            print(f"{done} runs are there already")
        else:
            print(f"at most {running.estimated(asked, running.most_runs(asked), workers)}")
        try:
            found = running.run(store, asked, workers, show_progress=True)
        except KeyboardInterrupt:
            print(f"stopped with {int(store.done.sum())} runs; the same command goes on")
            raise
        outcome.write(asked, found, out)
    head, *rows = outcome.told(asked, found)
    show_table(head, rows)
    for sentence in outcome.verdict(asked, found):
        print(sentence)
    print(f"written to {out}")
    return DONE
