"""What holds for all tests; the fixtures of a folder are in its own conftest.py."""

from __future__ import annotations

import sys

import pytest

import app  # noqa: F401  # says where kernels are cached, which must come before numba


def pytest_collection_finish(session: pytest.Session) -> None:
    """Constants over Omega are searched for once for all tests, not in each anew: many assemble the same arm.

    They are kept as the program keeps them between its starts, under the digest of every source that has a share in
    them; a test of the search itself brings a `Memory` of its own. Where no test has imported the simulation, nothing
    is to be done.
    """
    del session
    if system := sys.modules.get("app.simulation.system"):
        from app.process.kernel_cache import cache_folder
        from app.simulation.search_memory import Memory
        from app.storage.constants_store import ConstantsShelf

        shared = Memory(ConstantsShelf(cache_folder() / "constants of tests"))
        vars(system)["Memory"] = lambda: shared
