"""A server of viser alone, for widgets without a dashboard."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator

import pytest
import viser


@pytest.fixture
def viser_server() -> Iterator[viser.ViserServer]:
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()
