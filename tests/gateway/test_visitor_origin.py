"""Origin of requests that come through a proxy."""

from __future__ import annotations

from unittest.mock import MagicMock

import pytest
from aiohttp.test_utils import make_mocked_request
from multidict import CIMultiDict

from app.access.admission import Names
from app.gateway.visitor_origin import visitor_of


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
    headers = CIMultiDict([("X-Forwarded-For", line) for line in lines])
    transport = MagicMock()
    transport.get_extra_info.side_effect = lambda name, default=None: {"peername": ("127.0.0.1", 5)}.get(name, default)
    request = make_mocked_request("GET", "/", headers=headers, transport=transport)
    assert visitor_of(request, Names("127.0.0.1", public=("https://lab.example.org",))).address == address
