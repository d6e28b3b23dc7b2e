"""Command `vsmrc sweep plot`: draws what a sweep has found."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Annotated, get_args

import tyro

from app.cli.options import NO_DEFAULT_SHOWN, one_of, require_folder, written_to
from app.cli.status import DONE
from app.export.formats import Format
from app.process.terminal_text import print_line
from app.scenario.errors import ScenarioError


def sweep_plot(
    folder: Annotated[tyro.conf.Positional[Path | None], NO_DEFAULT_SHOWN] = None,
    /,
    *,
    of: str = "motion_error",
    within: Annotated[float | None, NO_DEFAULT_SHOWN] = None,
    show: Annotated[str | None, tyro.conf.arg(metavar="{share,median,worst}"), NO_DEFAULT_SHOWN] = None,
    over: Annotated[tuple[str, ...], NO_DEFAULT_SHOWN] = (),
    kind: Annotated[
        str | None, tyro.conf.arg(name="as", metavar="{map,slices,scatter,parallel}"), NO_DEFAULT_SHOWN
    ] = None,
    to: Annotated[str | None, tyro.conf.arg(metavar="{svg,pdf,png}"), NO_DEFAULT_SHOWN] = None,
    out: Annotated[Path | None, NO_DEFAULT_SHOWN] = None,
) -> int:
    """Draw the results of a sweep. The sweep need not be finished.

    Args:
        folder: folder of the sweep
        of: metric to draw (docs/sweeps.md)
        within: limit, in the metric's unit (docs/sweeps.md); the chart shows the share of the arms that keep it
        show: which value to show for the arms of a point; by default share with --within, else worst
        over: fields for the axes; by default the varied ones
        kind: kind of chart; by default the one that suits the fields
        to: file format; by default the format that the file's name says, or svg
        out: file to write; by default a file in the folder of the sweep, named after what is shown
    """
    from app.process.atomic_write import write_whole
    from app.sweep import charts, points
    from app.sweep.fingerprint import another_program, fingerprint
    from app.sweep.run_store import table_of

    if folder is None:
        raise ScenarioError("sweep plot: no folder; allowed: the folder of a sweep")
    if within is not None and not math.isfinite(within):
        raise ScenarioError(f"--within {within}; allowed: a finite number")
    form = _form(to, out)
    if out is not None:
        require_folder(out.parent)
    view = points.SweepView(
        metric=of,
        within=within,
        statistic=None if show is None else one_of("--show", show, get_args(points.Statistic)),
        over=over,
        kind=None if kind is None else one_of("--as", kind, get_args(points.Kind)),
    )
    sweep, columns = table_of(folder)
    if sweep.program != fingerprint(sweep):
        print_line(f"this sweep was computed by {another_program(sweep)}: a metric may have had another meaning")
    points.require_metric(columns, of)
    path, drawn = out or folder / f"{view.name}.{form}", charts.chart(sweep, columns, view, form)
    with written_to(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, lambda file: file.write(drawn))
    print(f"written: {path}")
    return DONE


def _form(to: str | None, out: Path | None) -> Format:
    """Form of the file that is asked for. Raises ScenarioError where the file's name says another one, or none, and
    where it is that of a folder."""
    forms: tuple[Format, ...] = get_args(Format)
    if to is not None:
        chosen: Format = one_of("--to", to, forms)
        forms = (chosen,)
    if out is None:
        return forms[0]
    if os.path.isdir(out):  # also a name that no file can have
        raise ScenarioError(f"--out {out}: is a folder; allowed: a file")
    if to is not None and not out.suffix:
        return forms[0]
    for form in forms:
        if out.suffix.lower() == f".{form}":
            return form
    given = f"ends in {out.suffix}" if out.suffix else "no ending"
    raise ScenarioError(f"--out {out}: {given}; allowed: a name that ends in {', '.join(f'.{form}' for form in forms)}")
