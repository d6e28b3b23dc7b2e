"""Folder of a sweep as one file, with the runs so far: unpacked, it is what `vsmrc sweep` writes."""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from app.export.export_jobs import plain_name
from app.sweep.fingerprint import fingerprint
from app.sweep.plan import Sweep
from app.sweep.run_metrics import RunMetrics
from app.sweep.run_store import LOCK, RunStore


def zipped(sweep: Sweep, rows: Sequence[RunMetrics]) -> bytes:
    """ZIP file of the folder of this sweep; the same command goes on in it. Raises OSError."""
    sweep = msgspec.structs.replace(sweep, program=fingerprint(sweep))
    return packed(f"{sweep.scenario.name}-sweep", lambda folder: write_rows(folder, sweep, rows))


def write_rows(folder: Path, sweep: Sweep, rows: Sequence[RunMetrics]) -> None:
    """Write a sweep and its rows into a folder. Raises OSError."""
    with RunStore(folder, sweep) as store:
        for row in rows:
            store.add(row)
        store.flush()


def packed(name: str, write: Callable[[Path], None]) -> bytes:
    """ZIP file of a folder of this name, with what `write` puts there."""
    file = io.BytesIO()
    with (
        tempfile.TemporaryDirectory(prefix="vsmrc-") as place,
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as zipped,
    ):
        folder, inside = Path(place), Path(plain_name(name))
        write(folder)
        for path in sorted(folder.rglob("*")):
            if path.is_file() and path.name != LOCK:
                zipped.write(path, inside / path.relative_to(folder))
    return file.getvalue()
