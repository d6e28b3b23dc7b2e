"""The engine of the runs that tests of the evidence make."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from app.simulation.engines import in_force


@pytest.fixture
def compiled() -> Iterator[None]:
    """Runs by the compiled engine, as `vsmrc figures --engine compiled` has them: it is the faster one, with the same
    rows (tests/simulation/test_compiled_run.py)."""
    before = in_force.set("compiled")
    yield
    in_force.reset(before)
