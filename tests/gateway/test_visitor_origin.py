"""Origin of requests that come through a proxy."""

from __future__ import annotations

from unittest.mock import MagicMock

import pytest
from aiohttp import web
from aiohttp.test_utils import make_mocked_request
from multidict import CIMultiDict

from app.access.admission import Names
from app.gateway.visitor_origin import is_local, visitor_of


@pytest.mark.parametrize(
    ("lines", "address"),
    [
        (["203.0.113.7"], "203.0.113.7"),
        (["198.51.100.1, 203.0.113.7"], "203.0.113.7"),
        (["198.51.100.1", "203.0.113.7"], "203.0.113.7"),  # a proxy that adds a line of its own
        (["::ffff:203.0.113.7"], "203.0.113.7"),
        (["2001:db8:1:2:3:4:5:6"], "2001:db8:1:2::/64"),
        (["unknown"], ""),
        ([], ""),
    ],
)
def test_the_address_is_the_one_that_the_proxy_has_added(lines: list[str], address: str) -> None:
    request = _request(CIMultiDict([("X-Forwarded-For", line) for line in lines]))
    assert visitor_of(request, Names("127.0.0.1", public=("https://lab.example.org",))).address == address


@pytest.mark.parametrize(
    "header", ["X-Forwarded-For", "X-Forwarded-Host", "X-Forwarded-Proto", "X-Real-IP", "Forwarded", "Via"]
)
def test_what_a_proxy_hands_over_is_not_local(header: str) -> None:
    assert is_local(_request(CIMultiDict({"Host": "127.0.0.1:8080"})))
    assert not is_local(_request(CIMultiDict({"Host": "127.0.0.1:8080", header: "203.0.113.7"})))


def _request(headers: CIMultiDict[str]) -> web.Request:
    """Request from a program of this machine."""
    transport = MagicMock()
    transport.get_extra_info.side_effect = lambda name, default=None: {"peername": ("127.0.0.1", 5)}.get(name, default)
    return make_mocked_request("GET", "/", headers=headers, transport=transport)
