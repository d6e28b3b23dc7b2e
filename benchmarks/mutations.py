"""Mutation test: would the tests detect a wrong sign? Mistakes of one line are planted in a copy of the tree, one at a
time.

    python -m benchmarks.mutations                     every row of mutations.toml, some three hours of two cores
    python -m benchmarks.mutations --only task_space   rows with this in their file or meaning
    python -m benchmarks.mutations --missing           rows without a verdict: goes on where another run was ended
    python -m benchmarks.mutations --write             only docs/mutations.md anew, after a row was edited
    python -m benchmarks.mutations --check             only whether rows fit the sources, and the document the rows

Each verdict is kept in mutations.jsonl as soon as it is known, with its day, beside those of other rows. From them
docs/mutations.md is written: a row without a verdict, or whose text has changed since, is "not run yet" there.

A row is caught when a test fails, and survives when the tests of its own file and all of `TESTS` pass; `--tests` names
others. There is a copy for each core, with a cache of compiled kernels of its own; in it every test file is tried
without any mistake before it judges one. A row begins with the kernels of those modules that do not import the changed
one, since numba looks only at a function's own file. A row whose tests fail without it, too, gets no verdict. Exit
status: 0 all caught, 1 some survived or got no verdict, 2 a row does not fit the sources, the document does not fit the
rows, or nothing has what `--only` names.
"""

from __future__ import annotations

import ast
import datetime
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

import msgspec
import tyro

from app.process.atomic_write import write_whole
from app.process.markdown import Table

ROOT = Path(__file__).parents[1]
PACKAGES = ("app", "controllers", "environments", "kernels", "parameters")
FOLDERS = (*PACKAGES, "static", "tests", "benchmarks", "drivers", "docs")
# quick tests, those that detect most come first: a row takes as long as the tests up to the first that fails
TESTS = (
    "tests/simulation/test_independent.py",
    "tests/controllers/test_switching.py",
    "tests/controllers/test_paper.py",
    "tests/controllers/test_mathematics.py",
    "tests/controllers/test_bounds.py",
    "tests/controllers/test_blend.py",
    "tests/simulation/test_closed_forms.py::test_every_friction_takes_energy_away",
    "tests/simulation/test_responses.py::test_sampled_force_loop_diverges_where_its_factor_says",
    "tests/simulation/test_closed_forms.py::test_sampled_force_of_a_heavy_surface_diverges_where_its_factor_says",
    "tests/session/test_timeline.py",
    "tests/session/test_pinned_runs.py",
    "tests/session/test_account.py",
    "tests/simulation/test_step_resolution.py",
    "tests/simulation/test_sampled_stability.py",
    "tests/simulation/test_sampled_force_loop.py",
    "tests/controllers/test_pd_gravity.py",
    "tests/simulation/test_drives.py",
    "tests/evidence/test_evidence_practice.py",
    "tests/kernels/test_kernels.py",
    "tests/simulation/test_domain.py",
    "tests/simulation/test_premises.py",
    "tests/simulation/test_judged_loops.py",
    "tests/simulation/test_reuse.py",
    "tests/simulation/test_task_coordinates.py",
)
PATIENCE = 1200.0  # s for one row
SECOND = 10**9  # ns
PAGE = ROOT / "docs" / "mutations.md"
KEPT = Path(__file__).with_suffix(".jsonl")
ENDLESS = "not done within"  # in place of a failing test
CAUGHT, SURVIVED, UNJUDGED, NOT_RUN = "caught", "SURVIVED", "not judged", "not run yet"


class Mutation(NamedTuple):
    """Mutation: a planted mistake.
    meaning: of the mistake, in words.
    file: that is changed.
    old: text that is replaced, which occurs in the file exactly once.
    new: text in its place.
    first: test file, without "test_", that should detect the mistake soonest and runs first; "" for the one with the
    name of `file`, if there is one."""

    meaning: str
    file: str
    old: str
    new: str
    first: str = ""

    @property
    def named(self) -> list[str]:
        """Paths of the test files that run first."""
        tests = (ROOT / "tests").rglob(f"test_{self.first or Path(self.file).stem}.py")
        return [str(file.relative_to(ROOT)) for file in tests]


def table() -> tuple[Mutation, ...]:
    """Rows of `mutations.toml`."""
    files = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    return tuple(Mutation(meaning, file, *row) for file, rows in files.items() for meaning, row in rows.items())


@dataclass(frozen=True)
class Verdict:
    """Verdict on a mutation."""

    mutation: Mutation
    result: str  # CAUGHT, SURVIVED, UNJUDGED
    by: str  # test that failed, or the end of the test run, or what tests printed that fail without the mutation
    day: datetime.date

    def __str__(self) -> str:
        m = self.mutation
        return f"{self.result:10s}{m.file:34s}{m.meaning:40s}{self.by}"


def misfits(rows: tuple[Mutation, ...]) -> list[str]:
    """Sentences on the rows whose old text does not occur exactly once in the sources, or that name no test file."""
    counts = {m: (ROOT / m.file).read_text(encoding="utf-8").count(m.old) for m in rows}
    unfit = [f"{m.file}: {m.old!r} ({m.meaning}) stands {n} times" for m, n in counts.items() if n != 1]
    return unfit + [f"{m.file}: no test_{m.first}.py ({m.meaning})" for m in rows if m.first and not m.named]


def importers(root: Path, changed: str) -> set[tuple[str, str]]:
    """Folder and name (("simulation", "system")) of every file that imports the changed one, directly or not, and its
    own. A file that imports by name, as tables of laws and surfaces do, imports its whole folder, and what it names."""
    files: dict[str, Path] = {}  # by module
    imports: dict[str, set[str]] = {}
    for package in (*PACKAGES, "tests"):  # tests hold kernels of their own
        for file in (root / package).rglob("*.py"):
            module = ".".join(file.relative_to(root).with_suffix("").parts).removesuffix(".__init__")
            files[module], names = file, set[str]()
            source = file.read_text(encoding="utf-8")
            for node in ast.walk(ast.parse(source)):
                if isinstance(node, ast.ImportFrom) and node.module:
                    names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    names.add(node.value)
            if "import_module(" in source:
                names |= {f"{module.rpartition('.')[0]}.{sibling.stem}" for sibling in file.parent.glob("*.py")}
            imports[module] = names
    found = {changed.removesuffix(".py").replace("/", ".").removesuffix(".__init__")}
    while more := {module for module, names in imports.items() if names & found} - found:
        found |= more
    return {(files[module].parent.name, files[module].stem) for module in found}


class Copy:
    """Copy of the tree in a folder, with a cache of kernels that fits the unchanged sources.
    tests: those that a mistake must survive."""

    def __init__(self, folder: Path, tests: tuple[str, ...]) -> None:
        self.tree, self._kernels, self._tests = folder / "tree", folder / "kernels", tests
        self._kernels.mkdir(parents=True)
        self._kernels_of_row = folder / "kernels of this row"
        self._passed: set[str] = set()  # tests that were tried without any mutation
        for name in FOLDERS:
            shutil.copytree(ROOT / name, self.tree / name, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy2(ROOT / "pyproject.toml", self.tree)

    def judge(self, mutation: Mutation) -> Verdict:
        """Verdict on a mutation: by the tests that should detect it, then by the others, one file after the other.
        Raises RuntimeError where a test fails without the mutation."""
        tests = dict.fromkeys([*mutation.named, *self._tests])
        try:
            by = next(filter(None, (self._failing(test, mutation) for test in tests)), "")
        finally:
            shutil.rmtree(self._kernels_of_row, ignore_errors=True)
        return Verdict(mutation, CAUGHT if by else SURVIVED, by, datetime.date.today())

    def _failing(self, tests: str, mutation: Mutation) -> str:
        """Test of these that fails with the mistake, or how the test run ended; "" where all pass. The file is
        restored, and the kernels that were compiled with the mistake stay for the row's other tests."""
        self._require_sound(tests)
        file = self.tree / mutation.file
        sound, time = file.read_text(encoding="utf-8"), file.stat().st_mtime_ns
        stale = importers(self.tree, mutation.file)
        for kept in self._kernels.glob("*/*"):
            package, module = kept.parent.name.rpartition("_")[0], kept.name.partition(".")[0]
            if (package, module) not in stale:
                there = self._kernels_of_row / kept.relative_to(self._kernels)
                there.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(kept, there)
        file.write_text(sound.replace(mutation.old, mutation.new), encoding="utf-8")
        os.utime(file, ns=(time, time + SECOND))  # numba compares it with the one that it noted beside a kernel
        try:
            done = self._run(tests, self._kernels_of_row, PATIENCE)
        except subprocess.TimeoutExpired:
            return f"{ENDLESS} {PATIENCE:g} s"
        finally:
            file.write_text(sound, encoding="utf-8")
            os.utime(file, ns=(time, time))
        failed = re.search(r"^(?:FAILED|ERROR) (?:tests/(?:\w+/)?)?(.+?)(?: - .*)?$", done.stdout, re.MULTILINE)
        return "" if done.returncode == 0 else failed[1] if failed else f"pytest ended with {done.returncode}"

    def _require_sound(self, tests: str) -> None:
        """Check that tests pass without any mutation, which compiles their kernels. Raises RuntimeError."""
        if tests in self._passed:
            return
        done = self._run(tests, self._kernels)
        if done.returncode != 0:
            raise RuntimeError(f"tests fail without any mutation:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
        self._passed.add(tests)

    def _run(self, tests: str, kernels: Path, timeout: float | None = None) -> subprocess.CompletedProcess[str]:
        """Run tests up to the first failure."""
        environment = os.environ | {
            "NUMBA_CACHE_DIR": str(kernels), "PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": str(self.tree),
            "OMP_NUM_THREADS": "1",
            # full optimisation would take longer than the runs, which last seconds; with none, numba leaves in each
            # kernel what it does not use, takes that for addresses of this process, and keeps nothing in its cache
            "NUMBA_OPT": "1",
        }  # fmt: skip
        command = [sys.executable, "-m", "pytest", "-x", "-q", "--tb=no", "-p", "no:cacheprovider", tests]
        return subprocess.run(
            command, cwd=self.tree, env=environment, capture_output=True, text=True, timeout=timeout, check=False
        )


def verdicts(rows: tuple[Mutation, ...], tests: tuple[str, ...], jobs: int) -> Iterator[Verdict]:
    """Verdicts in the order of the rows, as they become known; UNJUDGED for a row whose tests fail without it, too."""
    with tempfile.TemporaryDirectory(prefix="mutations-") as folder, ThreadPoolExecutor(jobs) as pool:
        idle: SimpleQueue[Copy] = SimpleQueue()
        for number in range(jobs):
            idle.put(Copy(Path(folder) / str(number), tests))

        def judged(mutation: Mutation) -> Verdict:
            copy = idle.get()
            try:
                return copy.judge(mutation)
            except RuntimeError as error:
                return Verdict(mutation, UNJUDGED, str(error), datetime.date.today())
            finally:
                idle.put(copy)

        yield from pool.map(judged, rows)


def kept_verdicts() -> dict[Mutation, Verdict]:
    """Verdicts of earlier runs on rows whose text is as it was, by row."""
    kept = msgspec.json.Decoder(Verdict).decode_lines(KEPT.read_bytes()) if KEPT.exists() else []
    known = {verdict.mutation[:-1]: verdict for verdict in kept}  # which tests run first changes no verdict
    return {row: known[row[:-1]] for row in table() if row[:-1] in known}


def keep(verdict: Verdict) -> None:
    """Keep a verdict beside the others and write the document."""
    found = kept_verdicts() | {verdict.mutation: verdict}
    text = msgspec.json.Encoder().encode_lines([found[row] for row in table() if row in found])
    write_whole(KEPT, lambda file: file.write(text))
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """Text of docs/mutations.md: every row, with the verdict that is kept on it."""
    rows, found = table(), kept_verdicts()
    verdicts = {row: (v.result, f"`{v.by}`" if v.by else "", str(v.day)) for row, v in found.items()}
    cells = [(f"`{row.file}`", row.meaning, *verdicts.get(row, (NOT_RUN, "", ""))) for row in rows]
    caught = sum(verdict.result == CAUGHT for verdict in found.values())
    endless = sum(verdict.by.startswith(ENDLESS) for verdict in found.values())
    return f"""# Planted mistakes

Of {len(rows)} planted mistakes, **{len(rows) - len(found)} have not been run yet** as they stand now. The tests caught
{caught} of the {len(found)} others, {endless} of them only because the tests did not end.

Each row is a mistake of one line, planted alone in a copy of the tree, and the first test that failed because of it on
the day that is given; code and tests may have changed since. The lines are those of `benchmarks/mutations.toml`;
`make mutations ARGS="--missing"` runs those that have not been run.

{Table(("file", "mistake", "", "by", "day"), cells).markdown()}
"""


def main(
    only: tuple[str, ...] = (),
    missing: bool = False,
    write: bool = False,
    check: bool = False,
    record: bool = True,
    tests: tuple[str, ...] = TESTS,
    jobs: int = os.cpu_count() or 1,
) -> int:
    """Plant mistakes, see whether the tests catch them.

    Args:
        only: rows with one of these in their file or meaning.
        missing: only rows on which no verdict is kept.
        write: only write the document anew.
        check: only see whether the rows fit the sources, and the document the rows.
        record: keep each verdict, and write the document with it.
        tests: what pytest is given; verdicts of other tests than these are not kept.
        jobs: how many at once; each takes a core and 3.7 GB.
    """
    wrong = misfits(table())
    if write:
        PAGE.write_text(page(), encoding="utf-8")
    if check and PAGE.read_text(encoding="utf-8") != page():
        wrong.append("docs/mutations.md does not fit mutations.toml: run python -m benchmarks.mutations --write")
    print("\n".join(wrong), file=sys.stderr, end="\n" if wrong else "")
    if wrong or write or check:
        return 2 if wrong else 0
    known = kept_verdicts()
    if unknown := [o for o in only if not any(o in m.file or o in m.meaning for m in table())]:
        print(f"--only {unknown[0]}: no row has this in its file or meaning", file=sys.stderr)
        return 2
    rows = tuple(m for m in table() if not only or any(o in m.file or o in m.meaning for o in only))
    rows = tuple(m for m in rows if not (missing and m in known))
    results = Counter[str]()
    for number, verdict in enumerate(verdicts(rows, tests, jobs), start=1):
        print(f"{number:3d}/{len(rows)}  {verdict}", flush=True)
        results[verdict.result] += 1
        if record and tests == TESTS and verdict.result != UNJUDGED:
            keep(verdict)
    caught, survived, unjudged = (results[each] for each in (CAUGHT, SURVIVED, UNJUDGED))
    print(f"{caught} of {len(rows)} caught, {survived} survived, {unjudged} not judged")
    return 0 if caught == len(rows) else 1


if __name__ == "__main__":
    sys.exit(tyro.cli(main))
