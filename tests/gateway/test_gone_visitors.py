"""Responses of the gateway where something goes wrong."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
from structlog.testing import capture_logs

from app.gateway.responses import _Connection


@pytest.mark.parametrize(("closing", "error", "faults"), [
    (True, ConnectionResetError("Cannot write to closing transport"), 0),  # a page that was left while it loaded
    (False, ConnectionResetError("the session's process has gone"), 1),
    (True, ValueError("planted"), 1),
])  # fmt: skip
def test_only_a_visitor_who_has_gone_is_no_fault(closing: bool, error: Exception, faults: int) -> None:
    transport, writer = SimpleNamespace(is_closing=lambda: closing), SimpleNamespace(output_size=0)
    request = SimpleNamespace(transport=transport, writer=writer)
    with capture_logs() as logs:
        _Connection.handle_error(cast(Any, None), cast(Any, request), exc=error)
    assert [entry["event"] for entry in logs].count("fault") == faults
