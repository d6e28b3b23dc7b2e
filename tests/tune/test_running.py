"""Runs of a tuning: the same answer however it is computed, better than poor gains, and nothing that breaks."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import msgspec
import pyarrow.parquet as pq
import pytest

from app.cli.commands import execute
from app.process import worker_pool
from app.process.worker_pool import BARRIER, FALLEN
from app.scenario.data import load, shipped, with_values
from app.scenario.errors import ScenarioError
from app.sweep.run_store import JOURNAL, RunStore
from app.sweep.running import BYTES
from app.tune import background, offers, outcome, running
from app.tune.candidates import Candidate
from app.tune.plan import Tuning, moved, program
from app.tune.running import TuningResult

DETUNED = with_values(
    shipped()["planar2r-semicircle"],
    {"simulation.duration": 0.2, "controller.layer": 0.1, "controller.K_s": 5.0},
)
TUNING = Tuning(
    DETUNED,
    (moved("controller.layer=0.0005:0.1:log"), moved("controller.K_s=5:400:log")),
    points=21,
    draw=2,
    unseen=3,
    aims=("residual", "torque_variation"),
    program=program(),
)

pytestmark = pytest.mark.slow  # simulations


def in_this_process(
    make: Callable[..., Callable[[Any], Any]], arguments: tuple[Any, ...], tasks: Iterable[Any], _: int
) -> Iterator[tuple[Any, Any]]:
    """Results of tasks as a pool of processes has them."""
    compute = make(*arguments)
    for task in tasks:
        if task is not BARRIER:
            yield task, compute(task)


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """No pool: its processes take seconds to begin."""
    monkeypatch.setattr(worker_pool, "results", in_this_process)


def tuned(folder: Path, tuning: Tuning = TUNING, workers: int = 1) -> TuningResult:
    with RunStore(folder, tuning) as store:
        return running.run(store, tuning, workers)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("tune")


@pytest.fixture(scope="module")
def found(folder: Path) -> TuningResult:
    """What two processes have found."""
    return tuned(folder, workers=2)


def test_what_is_offered_beats_poor_gains_on_arms_that_were_not_seen(found: TuningResult) -> None:
    best = outcome.comparisons(TUNING, found, offers.offered(TUNING, found)[0].number)[0]
    assert best.aim == "residual"
    assert best.change < -0.5
    assert best.better == TUNING.unseen


def test_a_candidate_that_changes_nothing_is_not_offered_and_one_that_changes_one_arm_is(found: TuningResult) -> None:
    first, own = offers.offered(TUNING, found)[0].number, found.runs[0]
    alike = replace(found, runs=found.runs | {first: own})
    assert first not in [each.number for each in offers.offered(TUNING, alike)]
    assert f"candidate {first} is not offered: it changes nothing" in " ".join(outcome.conclusions(TUNING, alike))
    another = replace(found, runs=found.runs | {first: [*own[:-1], own[-1] | {"residual": 0.1}]})
    assert first in [each.number for each in offers.offered(TUNING, another)]


def test_a_candidate_over_a_limit_is_kept_with_its_badge_and_not_offered(found: TuningResult) -> None:
    badges = {each.number: each.badge for each in found.candidates if each.badge}
    assert len(found.candidates) == TUNING.points
    assert any("robust terms, sampled" in badge for badge in badges.values())
    assert not badges.keys() & outcome.files_of(TUNING, found).keys()


def test_a_tuning_that_goes_on_has_the_same_answer_and_computes_nothing_twice(
    found: TuningResult, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def few(*arguments: Any) -> Iterator[Any]:
        yield from islice(in_this_process(*arguments), 9)
        raise KeyboardInterrupt

    added: list[int] = []
    with monkeypatch.context() as interrupting:
        interrupting.setattr(worker_pool, "results", few)
        with pytest.raises(KeyboardInterrupt):
            tuned(tmp_path)
    lines = (tmp_path / JOURNAL).read_bytes().splitlines()
    done = {msgspec.json.decode(line)["row"] for line in lines}
    add = RunStore.add
    monkeypatch.setattr(RunStore, "add", lambda store, row: (added.append(row["row"]), add(store, row)))
    again = tuned(tmp_path)
    assert done
    assert not done & set(added)
    assert again.candidates == found.candidates
    assert again.tried == found.tried
    added.clear()
    assert tuned(folder).tried == found.tried
    assert added == []


def test_runs_that_a_fault_has_ended_are_tried_again_unless_candidates_were_chosen_after_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own, unseen, early = 0, TUNING.seen, 2 * TUNING.arms  # of the own gains, and of the second candidate
    fallen = set[int]()

    def faulty(*arguments: Any) -> Iterator[Any]:
        for rows, metrics in in_this_process(*arguments):
            numbers = {row.number for row in rows}
            falls = bool(numbers & {own, unseen, early})
            fallen.update(numbers if falls else ())
            yield rows, FALLEN if falls else metrics

    with monkeypatch.context() as falling:
        falling.setattr(worker_pool, "results", faulty)
        first = tuned(tmp_path)
    assert first.candidates[2].badge
    added: list[int] = []
    add = RunStore.add
    monkeypatch.setattr(RunStore, "add", lambda store, row: (added.append(row["row"]), add(store, row)))
    again = tuned(tmp_path)
    assert set(added) == {number for number in fallen if number < early}
    assert {own, unseen} <= set(added)
    assert not again.candidates[0].badge
    assert again.candidates[1:] == first.candidates[1:]
    assert not again.tried[0].badge
    with RunStore(tmp_path, TUNING) as store:
        assert running.ended(store) == len(fallen) - len(added)


def test_the_pages_search_has_the_answer_of_the_command(found: TuningResult, tmp_path: Path) -> None:
    results = list(background.results(TUNING, 2))
    (theirs,) = (each for each in results if isinstance(each, TuningResult))
    assert theirs.candidates == found.candidates
    assert theirs.tried == found.tried
    assert [each for each in results if isinstance(each, Candidate)] == found.candidates
    rows = [each for each in results if isinstance(each, dict)]
    with zipfile.ZipFile(io.BytesIO(outcome.zipped(TUNING, rows, theirs))) as file:
        file.extractall(tmp_path)
    (taken_away,), commands = tmp_path.iterdir(), tmp_path / "command"
    commands.mkdir()
    outcome.write(TUNING, found, commands)
    for name in (outcome.TABLE, outcome.FIGURE, *outcome.files_of(TUNING, found).values()):
        assert (taken_away / name).read_bytes() == (commands / name).read_bytes(), name
    assert tuned(taken_away).candidates == found.candidates  # the command goes on in that folder, with nothing to do


def test_a_run_that_ends_its_process_leaves_the_estimate_without_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    assert running.estimated(TUNING, 5, 1).seconds is not None
    monkeypatch.setattr(worker_pool, "results", lambda _, __, tasks, ___: ((task, FALLEN) for task in tasks))
    estimate = running.estimated(TUNING, 5, 1)
    assert estimate.seconds is None
    assert str(estimate).startswith("5 runs of 1 s simulated time in all, 71 kB; their computing time is not known")


def test_an_unusable_candidate_is_a_row_and_other_runs_there_are_refused(tmp_path: Path) -> None:
    axes = (moved("controller.layer=-0.05:0.05"),)
    tuning = msgspec.structs.replace(TUNING, vary=axes, points=5, draw=0, unseen=1, aims=("residual",))
    refused = [each for each in tuned(tmp_path, tuning).candidates if "refused: controller.layer" in each.badge]
    assert refused
    assert all(math.isinf(each.aims[0]) for each in refused)
    with pytest.raises(ScenarioError, match=r"holds another tuning \(points \d+ there, \d+ here\)"):
        RunStore(tmp_path, msgspec.structs.replace(tuning, points=6))


def test_the_command_writes_scenarios_to_run_and_says_whether_the_own_gains_are_beaten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["tune", "planar2r-semicircle", "--move", "controller.layer=0.008:0.05:log", "--for", "residual"]
    asked += ["--budget", "5", "--unseen", "2", "--duration", "0.2", "--set", "controller.layer=0.1"]
    out = tmp_path / "out"
    assert execute([*asked, "--dry-run"]) == 0
    assert "at most 10 runs of 2 s simulated time" in capsys.readouterr().out
    assert execute([*asked, "--until", "0.1", "--dry-run"]) == 0
    assert "at most 10 runs of 1 s simulated time" in capsys.readouterr().out
    assert execute([*asked, "--out", str(out)]) == 0
    first = capsys.readouterr().out
    size = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
    assert pytest.approx(size, rel=0.2) == running.FILES + running.SCENARIO + 10 * BYTES
    assert "residual: best.toml better than the own gains, on the worst of the 2 test arms" in first
    assert execute([*asked, "--out", str(out)]) == 0
    assert "10 runs are there already" in capsys.readouterr().out
    table = pq.read_table(out / outcome.TABLE)
    (best,) = [row for row in table.to_pylist() if row["file"]]
    assert table.to_pylist()[0]["controller.layer"] == 0.1  # the own gains
    assert load(str(out / "best.toml")).controller.layer == best["controller.layer"] < 0.1
    assert table.schema.field("residual").metadata[b"unit"] == b"N"
    assert (out / outcome.FIGURE).read_bytes().startswith(b"<?xml")
    for more, sentence in (
        ((), "no folder for the runs"),
        (("--budget", "0", "--dry-run"), "--budget 0; allowed: 1 or more"),
        (("--workers", "0", "--dry-run"), "--workers 0; allowed: 1 to 512"),
        (("--workers", "513", "--dry-run"), "--workers 513; allowed: 1 to 512"),
        (("--for", "beauty", "--dry-run"), "--for 'beauty'"),
        (("--seed", "1", "--out", str(out)), "holds another tuning (seed 0 there, 1 here)"),
        (("--move", "controller.layer=nan:1", "--dry-run"), "--move controller.layer: nan; allowed: finite numbers"),
        (("--budget", "1000000000", "--dry-run"), "runs; allowed: at most 10⁷"),
        (("--move", "controller.layr=1:2", "--dry-run"), "controller.layr: no such field"),
        (
            ("--draw", "2", "--set", "truth.coulomb=1", "--dry-run"),
            "--set truth.coulomb: it is drawn for each true arm",
        ),
        (("--until", "0", "--dry-run"), "--until 0; allowed: more than 0 s, at most the duration of the runs"),
    ):
        once = [*asked[:6], *asked[8:]] if "--budget" in more else asked
        assert execute([*once, *more]) == 2
        assert sentence in (output := capsys.readouterr().err)
        assert output.count("\n") == 1
