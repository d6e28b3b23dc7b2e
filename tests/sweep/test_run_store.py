"""The store of a sweep's runs: whatever is killed, nothing is lost and nothing is there twice."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow.parquet as pq
import pytest

from app.process.atomic_write import write_whole
from app.scenario.data import edited, shipped
from app.scenario.errors import ScenarioError
from app.sweep import run_store
from app.sweep.axes import axis_of
from app.sweep.fingerprint import fingerprint
from app.sweep.plan import Sweep, SweepPlan
from app.sweep.run_metrics import ENDED, METRIC_COLUMNS
from app.sweep.run_store import JOURNAL, RunStore, parts, schema_of, table_of
from tests.sweep.test_plan import sweep_of

SWEEP = msgspec.structs.replace(  # 4,000 runs
    sweep_of("contact.K_e=1e3:1e5:50:log", "controller.K_s=20:80:80"), program=fingerprint()
)
ASKED = SweepPlan(SWEEP)


def metrics(number: int) -> dict[str, object]:
    """Metrics as a run would have them, found again in its row."""
    keys = ASKED.key_columns(ASKED.row(number))
    return keys | {"motion_error": 1e-6 * number, "stopped": None, "verdict": "holds"}


def fill(folder: Path, added: Callable[[int], object] | None = None) -> None:
    """Add whatever is missing, until it is done or killed. added: called with each row that has been added."""
    with RunStore(folder, SWEEP) as store:
        for number in np.flatnonzero(~store.done).tolist():
            store.add(metrics(number))
            if added is not None:
                added(number)
        store.flush()


# A process without threads, which forks one whenever it reads a line. That one fills the store until it is killed; its
# number and each row that it has added are written, each line at once: Python may write a text and its end apart.
FORKS = """
import os, signal, sys
from pathlib import Path
import app.sweep.run_store
from tests.sweep.test_run_store import fill
app.sweep.run_store.ROWS = 37
say = lambda what: os.write(1, f"{what}\\n".encode())
say("ready")
for line in sys.stdin:
    if (pid := os.fork()) == 0:
        say(os.getpid())
        fill(Path(sys.argv[1]), say)
        signal.pause()
    os.waitpid(pid, 0)
    say("ended")
"""


@pytest.mark.slow
def test_nothing_is_lost_or_there_twice_after_fifty_kills(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Killed at fifty instants, also while a part is made; what was added before is there, and the last one ends it."""
    random, seen = np.random.default_rng(4), [0]
    with subprocess.Popen(
        [sys.executable, "-c", FORKS, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as forks:
        assert forks.stdin is not None
        assert forks.stdout is not None
        assert forks.stdout.readline() == "ready\n"
        for _ in range(50):
            forks.stdin.write("\n")
            forks.stdin.flush()
            pid = int(forks.stdout.readline())
            rows = min(int(random.integers(0, 60)), ASKED.count - seen[-1])
            lines = [forks.stdout.readline() for _ in range(rows)]
            time.sleep(float(random.uniform(0.0, 0.003)))
            os.kill(pid, signal.SIGKILL)
            while (line := forks.stdout.readline()) != "ended\n":
                lines.append(line)
            with RunStore(tmp_path, SWEEP) as store:
                seen.append(int(store.done.sum()))
            assert len(lines) <= seen[-1] - seen[-2] <= len(lines) + 1
        forks.stdin.close()
    assert len(set(seen)) > 20  # the kills came in the middle
    assert parts(tmp_path)
    monkeypatch.setattr(run_store, "ROWS", 37)
    fill(tmp_path)
    sweep, columns = table_of(tmp_path)
    assert sweep == SWEEP
    assert columns["row"].tolist() == list(range(4000))
    assert columns["motion_error"] == pytest.approx(1e-6 * np.arange(4000))
    for number in (0, 777, 3999):
        row = ASKED.row(number)
        assert {path: columns[path][number] for path in row.values} == row.values


@pytest.mark.slow
def test_memory_stays_flat_over_a_hundred_thousand_runs(tmp_path: Path) -> None:
    sweep = msgspec.structs.replace(
        sweep_of("contact.K_e=1e3:1e5:50:log", "controller.K_s=20:80:2000"), program=fingerprint()
    )

    def megabytes() -> float:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    with RunStore(tmp_path, sweep) as store:
        before = 0.0
        for number in range(len(store.done)):
            numbers = dict.fromkeys(METRIC_COLUMNS, 1e-06 * number)
            store.add({"row": number, "point": number, "arm": 0, "contact.K_e": 1e3, "controller.K_s": 20.0} | numbers)
            if number == 20_000:
                before = megabytes()
        assert megabytes() < before + 20.0  # the rows themselves would take some 200 MB more
        assert store.done.all()


def test_a_run_that_was_ended_by_a_fault_is_tried_again_and_has_one_row(tmp_path: Path) -> None:
    fallen = metrics(1) | {"stopped": f"{ENDED}: out of memory", "motion_error": None}
    for flushed in (True, False):  # as a part, and as a line of the journal
        folder = tmp_path / str(flushed)
        with RunStore(folder, SWEEP) as store:
            for row in (metrics(0), fallen, metrics(2)):
                store.add(row)
            if flushed:
                store.flush()
        assert table_of(folder)[1]["row"].tolist() == [0, 1, 2]
        with RunStore(folder, SWEEP) as store:
            assert np.flatnonzero(store.done).tolist() == [0, 2]
            store.add(metrics(1))
            store.flush()
        with RunStore(folder, SWEEP) as store:
            assert np.flatnonzero(store.done).tolist() == [0, 1, 2]
        found = table_of(folder)[1]
        assert found["row"].tolist() == [0, 1, 2]
        assert found["motion_error"] == pytest.approx([0.0, 1e-6, 2e-6])


def test_strange_files_and_lines_are_not_runs(tmp_path: Path) -> None:
    with RunStore(tmp_path, SWEEP) as store:
        store.add(metrics(0))
        store.flush()
    (part,) = parts(tmp_path)
    part.with_name("part-000001 (copy).parquet").write_bytes(b"of another program")
    with (tmp_path / JOURNAL).open("ab") as file:
        file.write(b'{"row": 5, "motion_error": "x"}\n{"row": 6, "stopped": 1}\n')
    with RunStore(tmp_path, SWEEP) as store:
        assert np.flatnonzero(store.done).tolist() == [0]
    assert table_of(tmp_path)[1]["row"].tolist() == [0]


def test_a_line_that_was_cut_off_is_forgotten_and_a_part_says_units(tmp_path: Path) -> None:
    with RunStore(tmp_path, SWEEP) as store:
        for number in range(3):
            store.add(metrics(number))
    with (tmp_path / JOURNAL).open("ab") as file:
        file.write(b'{"row": 3, "point":')
    with RunStore(tmp_path, SWEEP) as store:
        assert np.flatnonzero(store.done).tolist() == [0, 1, 2]
        store.flush()
    (part,) = parts(tmp_path)
    schema = pq.read_schema(part)
    assert schema.field("motion_error").metadata[b"unit"] == b"m"
    varied = schema.field("contact.K_e").metadata
    assert (varied[b"unit"], varied[b"meaning"]) == (b"N/m", b"varied field: stiffness of the surface")
    assert (tmp_path / JOURNAL).read_bytes() == b""


def test_a_part_of_a_sweep_in_joint_space_says_its_units() -> None:
    schema = schema_of(Sweep(shipped()["ur5-joint"], (axis_of("controller.layer=0.01:0.02:2"),)))
    units = {name: schema.field(name).metadata[b"unit"].decode() for name in ("motion_error", "residual", "wall_time")}
    assert units == {"motion_error": "rad", "residual": "N·m", "wall_time": "s"}


def test_a_damaged_part_is_said(tmp_path: Path) -> None:
    with RunStore(tmp_path, SWEEP) as store:
        store.add(metrics(0))
        store.flush()
    (part,) = parts(tmp_path)
    part.write_bytes(b"PAR1 and no more")
    for look in (lambda: table_of(tmp_path), lambda: RunStore(tmp_path, SWEEP)):
        with pytest.raises(ScenarioError, match=r"part-000001.parquet: cannot be read as Parquet; allowed: remove it"):
            look()


def test_a_crash_between_part_and_journal_leaves_no_row_twice(tmp_path: Path) -> None:
    with RunStore(tmp_path, SWEEP) as store:
        store.add(metrics(0))
        lines = (tmp_path / JOURNAL).read_bytes()
        store.flush()
    (tmp_path / JOURNAL).write_bytes(lines)  # as if the process had ended before it was emptied
    with RunStore(tmp_path, SWEEP) as store:
        store.add(metrics(1))
        store.flush()
    assert table_of(tmp_path)[1]["row"].tolist() == [0, 1]


@pytest.mark.parametrize("interrupted", ["part-000001.parquet", JOURNAL])
def test_ctrl_c_behind_the_writing_of_a_file_leaves_no_row_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, interrupted: str
) -> None:
    def write_and_stop(path: Path, *arguments: Any) -> None:
        write_whole(path, *arguments)
        if path.name == interrupted:
            raise KeyboardInterrupt

    with RunStore(tmp_path, SWEEP) as store:
        store.add(metrics(0))
        with monkeypatch.context() as stopping:
            stopping.setattr(run_store, "write_whole", write_and_stop)
            with pytest.raises(KeyboardInterrupt):
                store.flush()
        store.flush()  # as the command does it after Ctrl-C
    with RunStore(tmp_path, SWEEP) as store:
        store.add(metrics(1))
        store.flush()
        assert [row["row"] for row in store.rows] == [0, 1]
    assert pq.read_table(tmp_path / "runs.parquet")["row"].to_pylist() == [0, 1]


def test_rows_that_an_earlier_version_has_written_twice_are_drawn_once(tmp_path: Path) -> None:
    with RunStore(tmp_path, SWEEP) as store:
        store.add(metrics(0))
        store.flush()
    (part,) = parts(tmp_path)
    part.with_name("part-000002.parquet").write_bytes(part.read_bytes())
    assert table_of(tmp_path)[1]["row"].tolist() == [0]


def test_another_question_is_refused_with_what_differs(tmp_path: Path) -> None:
    with RunStore(tmp_path, SWEEP):
        pass
    scenario = edited(SWEEP.scenario, "force.value", SWEEP.scenario.force.value + 1.0)
    with pytest.raises(
        ScenarioError, match=r"\(force\.value [\d.]+ there, [\d.]+ here; vary \S+ there, not given here\)"
    ):
        RunStore(tmp_path, msgspec.structs.replace(SWEEP, scenario=scenario, vary=()))


def test_a_folder_of_another_sweep_or_in_use_is_refused(tmp_path: Path) -> None:
    with RunStore(tmp_path, SWEEP), pytest.raises(ScenarioError, match="another sweep writes there now"):
        RunStore(tmp_path, SWEEP)
    with pytest.raises(ScenarioError, match=r"holds another sweep \(seed \d+ there, \d+ here\)"):
        RunStore(tmp_path, msgspec.structs.replace(SWEEP, seed=2))
    with pytest.raises(ScenarioError, match="another version of the program"):
        RunStore(tmp_path, msgspec.structs.replace(SWEEP, program="other"))
    with RunStore(tmp_path, SWEEP):
        pass
    with pytest.raises(ScenarioError, match="no runs yet"):
        table_of(tmp_path)
    with pytest.raises(ScenarioError, match="cannot be read: No such file"):
        table_of(tmp_path / "gone")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_said_and_what_is_there_stays(tmp_path: Path) -> None:
    with RunStore(tmp_path, SWEEP) as store:
        store.add(metrics(0))
    with RunStore(tmp_path, SWEEP) as store:
        kept, store._journal = store._journal, os.open("/dev/full", os.O_WRONLY)
        with pytest.raises(OSError, match="No space left"):
            store.add(metrics(1))
        os.close(store._journal)
        store._journal = kept
    with RunStore(tmp_path, SWEEP) as store:
        assert np.flatnonzero(store.done).tolist() == [0]


def test_rows_that_wait_in_the_journal_are_drawn_too(tmp_path: Path) -> None:
    store = RunStore(tmp_path, SWEEP)
    store.add(metrics(7))
    _, columns = table_of(tmp_path)  # as after a kill: nothing was settled
    assert columns["row"].tolist() == [7]
    store.flush()
    store.add(metrics(3))
    _, columns = table_of(tmp_path)
    assert columns["row"].tolist() == [3, 7]
    assert columns["motion_error"] == pytest.approx([3e-6, 7e-6])


@pytest.mark.parametrize("read", ["journaled", "parts"])
def test_rows_that_a_running_sweep_settles_while_they_are_read_are_there_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read: str
) -> None:
    with RunStore(tmp_path, SWEEP) as store:
        store.add(metrics(7))
        reading = getattr(run_store, read)

        def read_and_settle(*arguments: Any) -> Any:
            found = reading(*arguments)
            store.flush()
            return found

        monkeypatch.setattr(run_store, read, read_and_settle)
        assert table_of(tmp_path)[1]["row"].tolist() == [7]


def test_a_sweep_of_another_version_is_drawn_with_the_columns_that_both_have(tmp_path: Path) -> None:
    with RunStore(tmp_path, msgspec.structs.replace(SWEEP, program="older")) as store:
        store.add(metrics(7))
        store.flush()
        store.add(metrics(3))
    (part,) = parts(tmp_path)
    table = pq.read_table(part)
    older = table.drop_columns(["residual", "failed"]).append_column("friction_error", table["motion_error"])
    pq.write_table(older, part)
    _, columns = table_of(tmp_path)
    assert columns["row"].tolist() == [3, 7]
    assert columns["motion_error"] == pytest.approx([3e-6, 7e-6])
    assert np.isnan(columns["residual"]).all()
    assert columns["failed"].tolist() == [None, None]
    assert list(columns) == schema_of(SWEEP).names
    for strange in (table.drop_columns(["point"]), table.drop_columns(["row"]), table.drop_columns(["controller.K_s"])):
        pq.write_table(strange, part)
        with pytest.raises(ScenarioError, match=r"another version of the program; allowed: `vsmrc sweep plot`"):
            table_of(tmp_path)
    part.write_bytes(b"no Parquet file")
    with pytest.raises(ScenarioError, match=r"another version of the program; allowed: `vsmrc sweep plot`"):
        table_of(tmp_path)


def test_a_part_of_another_sweep_and_lines_that_are_no_rows_are_not_taken(tmp_path: Path) -> None:
    other = sweep_of("contact.K_e=1e3:1e5:5:log")
    with RunStore(tmp_path / "other", other) as store:
        store.add(SweepPlan(other).key_columns(SweepPlan(other).row(4)) | {"verdict": "holds"})
        store.flush()
    with RunStore(tmp_path / "own", SWEEP) as store:
        store.add(metrics(7))
        store.flush()
    (tmp_path / "own" / JOURNAL).write_bytes(b'{"row": 5000}\n[1, 2]\n{"row": "x"}\n')
    with RunStore(tmp_path / "own", SWEEP) as store:
        assert np.flatnonzero(store.done).tolist() == [7]
    (strange,) = parts(tmp_path / "other")
    strange.rename(tmp_path / "own" / "runs.parquet" / "part-000009.parquet")
    for read in (lambda: table_of(tmp_path / "own"), lambda: RunStore(tmp_path / "own", SWEEP)):
        with pytest.raises(
            ScenarioError, match=r"part-000009\.parquet: holds runs of something else; allowed: remove it"
        ):
            read()
