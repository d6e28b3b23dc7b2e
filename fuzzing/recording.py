"""Fuzzing of recordings that somebody sends."""

import io
import tempfile
from contextlib import suppress
from pathlib import Path

import numpy as np

from app.scenario.data import load
from app.scenario.errors import ScenarioError
from app.simulation.recording import Recording
from app.storage.recording_files import read_npz, table, write_npz

DICTIONARY = ("PK\x03\x04", "PK\x01\x02", "PK\x05\x06", "{'descr': '<f8'", "'shape': (2, 6)", "|O", "NUMPY")


def _seed() -> bytes:
    recording = Recording(2, history=8)
    for k in range(2):
        recording.new_row().view(float)[:] = k
        recording.commit()
    file = io.BytesIO()
    write_npz(table(load("planar2r-semicircle"), recording), file)
    with np.load(io.BytesIO(file.getvalue())) as arrays:  # unpacked, so that its contents can be reached
        plain = io.BytesIO()
        np.savez(plain, **arrays)
    return plain.getvalue()


SEEDS = (_seed(),)
_FILE = Path(tempfile.mkdtemp(prefix="vsmrc-fuzz-")) / "recording.npz"


def read(data: bytes) -> None:
    _FILE.write_bytes(data)
    with suppress(ScenarioError):
        read_npz(_FILE)
