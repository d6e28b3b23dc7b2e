"""Run of the sections' jobs on all cores, which writes evidence.md with its figures."""

from __future__ import annotations

import multiprocessing
import os
import platform
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import version
from pathlib import Path
from typing import Any

from tqdm import tqdm

from app.evidence.section import Job, Section

PICTURES = "evidence"  # folder beside evidence.md
OPENING = """# Evidence

Written by `vsmrc figures --out {out}{thin}`: every number and figure below comes from that command, only the prose is
by hand. Made with Python {python}, pin {pin}, numpy {numpy}, numba {numba}.{share}
"""


def make(sections: Sequence[Section], thin: int, out: Path, workers: int | None = None) -> Path:
    """Write evidence.md and its figures into the folder `out`, from one in `thin` of the cases; returns the page.

    A section that cannot run here says on the page what it needs. Raises OSError.
    """
    pictures = out / PICTURES
    pictures.mkdir(parents=True, exist_ok=True)
    jobs = {section.name: section.jobs(thin) for section in sections if not section.missing()}
    results = _run(jobs, workers or os.cpu_count() or 1)
    texts = [_opening(out, thin)]
    for section in sections:
        if missing := section.missing():
            texts.append(f"{section.heading}\n\n*Not run here; it needs {', '.join(missing)}.*\n")
            continue
        findings = section.conclude(results[section.name])
        for name, svg in findings.figures.items():
            (pictures / f"{section.name}-{name}.svg").write_bytes(svg)
        texts.append(section.text(findings, PICTURES))
    page = out / "evidence.md"
    page.write_text("\n".join(texts), encoding="utf-8")
    return page


def _run(jobs: Mapping[str, Sequence[Job]], workers: int) -> dict[str, list[Any]]:
    """Results by section, in the order of its jobs, in whatever order they end."""
    with (
        # spawned, since the fork of a process that has threads may hang
        ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _end_with_parent) as pool,
        tqdm(total=sum(map(len, jobs.values())), unit=" jobs", desc="evidence") as bar,
    ):
        futures = {name: [pool.submit(job.function, *job.arguments) for job in of] for name, of in jobs.items()}
        for of in futures.values():
            for future in of:
                future.add_done_callback(lambda _: bar.update())
        try:
            return {name: [future.result() for future in of] for name, of in futures.items()}
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _end_with_parent() -> None:
    """End a worker of the pool with its owner: it would wait for ever for one that was killed."""

    def watch() -> None:
        if owner := multiprocessing.parent_process():
            owner.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _opening(out: Path, thin: int) -> str:
    return OPENING.format(
        out=out,
        thin=f" --thin {thin}" if thin > 1 else "",
        share=f" **One in {thin} of the cases only.**" if thin > 1 else "",
        python=platform.python_version(),
        **{name: version(name) for name in ("pin", "numpy", "numba")},
    )
