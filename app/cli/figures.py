"""Command `vsmrc figures`: computes the evidence anew."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from app.cli.options import NO_DEFAULT_SHOWN, EngineOption, engine_of, require_folder, written_to
from app.cli.status import DONE
from app.scenario.errors import ScenarioError
from parameters import allowed


def figures(
    *,
    out: Path,
    only: Annotated[tuple[str, ...], NO_DEFAULT_SHOWN] = (),
    thin: int = 1,
    engine: EngineOption = None,
) -> int:
    """Recompute the evidence on all cores. Writes evidence.md with every figure and number of docs/evidence.md.

    Args:
        out: folder for the files
        only: names of the sections to compute, such as theorem or families; by default all sections
        thin: for a quick look, compute only every N-th case
        engine: pinocchio, or compiled, which is faster; their results differ by rounding (docs/command-line.md)
    """
    from app.evidence.make import make
    from app.evidence.sections import SECTIONS

    by = engine_of(engine)
    names = [section.name for section in SECTIONS]
    if unknown := [name for name in only if name not in names]:
        raise ScenarioError(f"--only {unknown[0]}: {allowed(unknown[0], names)}")
    if thin < 1:
        raise ScenarioError(f"--thin {thin}: allowed: 1 or more")
    require_folder(out)
    with written_to(out):
        page = make([section for section in SECTIONS if not only or section.name in only], thin, out, engine=by)
    print(f"written: {page}")
    return DONE
