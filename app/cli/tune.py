"""Command `vsmrc tune`: searches for better gains."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import tyro

from app.cli.options import (
    NO_DEFAULT_SHOWN,
    REPEATABLE,
    Settings,
    configured,
    folder_of,
    note_without_effect,
    require_until,
    require_workers,
    settings_of,
    written_to,
)
from app.cli.status import DONE, FAULT
from app.cli.tables import show_table
from app.scenario.errors import ScenarioError
from app.scenario.number_text import counted

if TYPE_CHECKING:
    from app.tune.plan import Tuning


def tune(
    scenario: Annotated[str, tyro.conf.Positional],
    /,
    *,
    move: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], REPEATABLE] = (),
    aims: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(name="for", metavar="METRIC"), REPEATABLE
    ] = (),
    draw: int = 0,
    budget: int = 120,
    unseen: int = 32,
    seed: int = 0,
    out: Annotated[Path | None, NO_DEFAULT_SHOWN] = None,
    duration: Annotated[float | None, NO_DEFAULT_SHOWN] = None,
    until: Annotated[float | None, NO_DEFAULT_SHOWN] = None,
    workers: Annotated[int | None, NO_DEFAULT_SHOWN] = None,
    dry_run: bool = False,
    settings: Settings = (),
) -> int:
    """Search for better gains of a scenario. The worst of many true arms decides how good a candidate is. At the end,
    the best gains are tried on test arms, which the search did not use. If you stop the search, the same command
    continues it.

    Args:
        scenario: a shipped scenario or a .toml file; the search tries to beat its gains
        move: gain to search over, a field of controller or target_model: PATH=LOW:HIGH; add :log to search on a
            logarithmic scale
        aims: metric to minimise, such as force_error (docs/tuning.md lists them); give it twice for two metrics, and
            the result is a Pareto front
        draw: number of true arms, drawn at random inside the declared set, the same for every candidate; 0: use the
            scenario's own true arm
        budget: number of candidates, not counting the scenario's own gains
        unseen: number of new true arms for the final test, which compares the best gains with the scenario's own
        seed: seed of the random arms and the search; the same seed gives the same result with any number of processes
        out: folder for the runs, the best scenarios, and a figure; required, except with --dry-run
        duration: simulated time of each run in s; by default the duration that the scenario sets
        until: end each run at this time, s, before its duration; the controller's constants are still computed for the
            whole duration
        workers: number of processes; by default one for each core
        dry_run: do not run the search; only estimate its time and disk space
    """
    from app.tune import plan

    _require_counts(draw=draw, budget=budget, unseen=unseen, seed=seed)
    require_workers(workers)
    require_until(until)
    tuning = plan.Tuning(
        scenario=configured(scenario, settings, duration),
        vary=tuple(map(plan.moved, move)),
        points=budget + 1,
        draw=draw,
        seed=seed,
        until=until or 0.0,
        aims=aims,
        unseen=unseen,
    )
    tuning = _checked(tuning, settings)
    return _estimate(tuning, workers) if dry_run else _tune_into(folder_of("tune", out), tuning, workers)


def _require_counts(*, draw: int, budget: int, unseen: int, seed: int) -> None:
    """Raises ScenarioError for a number of arms or candidates, or a seed, that is not possible."""
    from app.tune.plan import LARGEST_SEED

    for name, given, least in (("draw", draw, 0), ("budget", budget, 1), ("unseen", unseen, 1), ("seed", seed, 0)):
        if given < least:
            raise ScenarioError(f"--{name} {given}; allowed: {least} or more")
    if seed > LARGEST_SEED:
        raise ScenarioError(f"--seed {seed}; allowed: at most {LARGEST_SEED}")


def _checked(tuning: Tuning, settings: Settings) -> Tuning:
    """The tuning with the fingerprint of the program, if it can be computed. Raises ScenarioError."""
    from app.sweep.plan import require_not_drawn
    from app.tune import plan

    tuning = msgspec.structs.replace(tuning, program=plan.program(tuning))
    require_not_drawn(tuning, dict(settings_of(settings)))
    plan.require_sound(tuning)
    note_without_effect(settings, tuning.scenario)
    return tuning


def _estimate(tuning: Tuning, workers: int | None) -> int:
    """Print the time and the disk space that the tuning takes at most."""
    from app.tune import running

    print(f"at most {running.estimated(tuning, running.most_runs(tuning), workers)}")
    return DONE


def _tune_into(out: Path, tuning: Tuning, workers: int | None) -> int:
    from app.sweep.run_store import RunStore
    from app.tune import outcome, running

    with written_to(out, "; what is there stays"), RunStore(out, tuning) as store:
        if done := int(store.done.sum()):
            print(f"{counted(done, 'run')} {'is' if done == 1 else 'are'} there already")
        else:
            _estimate(tuning, workers)
        try:
            found = running.run(store, tuning, workers, show_progress=True)
        except KeyboardInterrupt:
            print(f"stopped with {counted(int(store.done.sum()), 'run')}; the same command goes on")
            raise
        outcome.write(tuning, found, out)
        ended = running.ended(store)
    head, *rows = outcome.summary_rows(tuning, found)
    show_table(head, rows)
    for sentence in outcome.conclusions(tuning, found):
        print(sentence)
    print(f"written to {out}")
    if ended:
        print(
            f"runs that a fault has ended (column stopped): {ended}; the same command tries them again, but not those "
            "after which further candidates were chosen"
        )
        return FAULT
    return DONE
