"""Maker of the evidence: runs the sections' jobs on all cores, and writes evidence.md with its figures."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from operator import methodcaller
from pathlib import Path
from typing import Any

from tqdm import tqdm

from app.evidence.section import EvidenceSection, Job
from app.evidence.sections import SECTIONS
from app.process import worker_pool
from app.process.atomic_write import write_whole
from app.process.cores import usable_cores
from app.simulation.engines import Engine, in_force

PICTURES = "evidence"  # folder beside evidence.md
OPENING = """# Evidence

Written by `vsmrc figures --out {out}{more}`: every number and figure below comes from that command, only the prose is
by hand. Made with Python {python}, pin {pin}, numpy {numpy}, numba {numba}.{share}
"""


def make(
    sections: Sequence[EvidenceSection], thin: int, out: Path, workers: int | None = None, engine: Engine = "pinocchio"
) -> Path:
    """Write evidence.md and its figures into the folder `out`. Returns the path of evidence.md. Raises OSError.

    thin: number of cases of which one is computed.
    engine: of the runs that do not name one, where it can take them. Of a section that cannot run on this machine, the
    file says what it needs.
    """
    pictures = out / PICTURES
    pictures.mkdir(parents=True, exist_ok=True)
    jobs = {section.name: section.jobs(thin) for section in sections if not section.missing()}
    results = _run(jobs, workers or usable_cores(), engine)
    texts, figures = [_opening(out, sections, thin, engine)], dict[Path, bytes]()
    for section in sections:
        if missing := section.missing():
            texts.append(f"{section.heading}\n\n*Not run here; it needs {', '.join(missing)}.*\n")
            continue
        findings = section.conclude(results[section.name])
        figures |= {pictures / f"{section.name}-{name}.svg": svg for name, svg in findings.figures.items()}
        texts.append(section.text(findings, PICTURES))
    page = out / "evidence.md"  # nothing is written before all is known: figures and text fit each other
    for path, content in (figures | {page: "\n".join(texts).encode()}).items():
        write_whole(path, methodcaller("write", content))
    return page


def _run(jobs: Mapping[str, Sequence[Job]], workers: int, engine: Engine) -> dict[str, list[Any]]:
    """Results of each section, in the order of its jobs. Raises RuntimeError for a job whose process ends each time."""
    found: dict[str, dict[int, Any]] = {name: {} for name in jobs}
    tasks = [(name, number, job) for name, of in jobs.items() for number, job in enumerate(of)]
    with tqdm(total=len(tasks), unit=" jobs", desc="evidence") as bar:
        for (name, number, job), result in worker_pool.results(_doer, (engine,), tasks, workers):
            if result is worker_pool.FALLEN:
                raise RuntimeError(f"{name}: the process of {job.function.__name__}{job.arguments} ends each time")
            found[name][number] = result
            bar.update()
    return {name: [of[number] for number in range(len(of))] for name, of in found.items()}


def _doer(engine: Engine) -> Callable[[tuple[str, int, Job]], Any]:
    in_force.set(engine)  # for the whole process, which has no other task
    return lambda task: task[2].function(*task[2].arguments)


def _opening(out: Path, sections: Sequence[EvidenceSection], thin: int, engine: Engine) -> str:
    only = "" if len(sections) == len(SECTIONS) else f" --only {' '.join(section.name for section in sections)}"
    return OPENING.format(
        out=out,
        more=only + (f" --thin {thin}" if thin > 1 else "") + (f" --engine {engine}" if engine != "pinocchio" else ""),
        share=f" **One in {thin} of the cases only.**" if thin > 1 else "",
        python=platform.python_version(),
        **{name: version(name) for name in ("pin", "numpy", "numba")},
    )
