"""Store of constants over Omega on disk, one small file each, beside the compiled kernels.

A file is trusted only if its checksum fits and every number is finite and none negative; otherwise the numbers are
searched for again. The name of a file depends on all that its numbers depend on, also on the sources that found them.
"""

from __future__ import annotations

import contextlib
import hashlib
import math
from functools import cached_property
from importlib import metadata
from pathlib import Path

import msgspec

from app.process.atomic_write import write_whole
from app.process.json_text import decode_json
from app.process.kernel_cache import cache_folder
from app.simulation.omega.search_memory import Memory, Numbers
from app.storage.cache_eviction import evict

KEPT = 1000  # files
LONGEST = 1000  # bytes of one
_PRIVATE = 0o600


class _Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    numbers: tuple[float, ...]
    checksum: str


def _checksum(name: str, numbers: Numbers) -> str:
    return hashlib.sha256(f"{name} {numbers!r}".encode()).hexdigest()


class ConstantsStore:
    """Constants kept on disk, a `search_memory.AnswerStore`: in a folder, by default that of the kernels. Disk errors
    are ignored. kept: number of files from which on half of them are removed."""

    def __init__(self, folder: Path | None = None, kept: int = KEPT) -> None:
        self._folder, self._kept = folder if folder is not None else cache_folder() / "constants", kept

    def read(self, key: str, count: int) -> Numbers | None:
        """Kept numbers of a search, None where there are none; see `search_memory.AnswerStore`."""
        path = self._path(key)
        try:
            if not path.is_file():
                return None
            with open(path, "rb") as file:
                content = file.read(LONGEST + 1)
            if len(content) > LONGEST:
                return None
            entry = decode_json(content, _Entry)
        except (OSError, ValueError):
            return None
        sound = len(entry.numbers) == count and all(math.isfinite(x) and x >= 0.0 for x in entry.numbers)
        return entry.numbers if sound and entry.checksum == _checksum(path.name, entry.numbers) else None

    def write(self, key: str, numbers: Numbers) -> None:
        """See `search_memory.AnswerStore`. An atomic write, but not flushed: a power cut may lose the file."""
        path = self._path(key)
        content = msgspec.json.encode(_Entry(numbers, _checksum(path.name, numbers)))
        with contextlib.suppress(OSError):
            self._folder.mkdir(parents=True, exist_ok=True)
            evict(self._folder, self._kept)
            write_whole(path, lambda file: file.write(content), _PRIVATE, synced=False)

    def _path(self, key: str) -> Path:
        return self._folder / (hashlib.sha256(f"{self._version} {key}".encode()).hexdigest() + ".json")

    @cached_property
    def _version(self) -> str:
        """Digest of every source that the numbers depend on, and of the versions of the libraries."""
        root = Path(__file__).parents[2]
        digest = hashlib.sha256()
        for package in ("app/scenario", "app/simulation", "controllers", "environments", "kernels"):
            for file in sorted((root / package).rglob("*.py")):
                digest.update(file.name.encode() + b" " + file.read_bytes())
        for library in ("numpy", "scipy", "pin", "numba"):
            digest.update(f"{library} {metadata.version(library)} ".encode())
        return digest.hexdigest()


def kept_memory() -> Memory:
    """Memory of the searched constants, shared with later programs by a `ConstantsStore`."""
    return Memory(ConstantsStore())
