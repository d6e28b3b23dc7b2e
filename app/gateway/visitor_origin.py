"""Origin of a request to a gateway: browser, address, and whether it comes from this machine."""

from __future__ import annotations

import ipaddress
import re
from urllib.parse import urlsplit

from aiohttp import web

from app.access.admission import Names, is_loopback
from app.gateway.visitors import Visitor

_WORD = re.compile(r"[A-Za-z0-9_-]{22}")  # 128 bits, as `new_secret(16)` writes them
_PROXIED = ("X-Forwarded-For", "X-Forwarded-Host", "X-Forwarded-Proto", "X-Real-IP", "Forwarded", "Via")


def visitor_of(request: web.Request, names: Names) -> Visitor:
    """Visitor who sends a request, as far as that can be told."""
    browser = request.cookies.get(visitor_cookie(request), "")
    return Visitor(browser if _WORD.fullmatch(browser) else "", _address(request, names))


def visitor_cookie(request: web.Request) -> str:
    """Name of the cookie by which a browser is recognized."""
    return f"vsmrc-visitor-{port_of(request)}"


def port_of(request: web.Request) -> int:
    """Port of the server, for the names of cookies: browsers keep the cookies of all ports of a host together."""
    address = request.get_extra_info("sockname")
    return address[1] if address else 0


def is_local(request: web.Request) -> bool:
    """Whether a program of this machine sends the request, and not a proxy on behalf of another machine."""
    try:
        name = urlsplit(f"//{request.host}").hostname or ""
    except ValueError:
        return False
    proxied = any(header in request.headers for header in _PROXIED)
    return is_loopback(request.remote or "") and is_loopback(name) and not proxied


def asks_status(request: web.Request) -> bool:
    """Whether the request is about the server, and not about a session."""
    return request.path in ("/healthz", "/metrics")


def _address(request: web.Request, names: Names) -> str:
    """Address of the visitor's machine, with IPv6 that of its network; "" for programs of this machine and for requests
    through a proxy that does not name an address."""
    address = request.remote or ""
    if is_loopback(address):
        lines = request.headers.getall("X-Forwarded-For", []) if names.public else []
        address = ",".join(lines).rpartition(",")[2].strip()  # the last one, which the proxy has added
        if address.count(":") == 1:  # some proxies add the port
            address = address.partition(":")[0]
    try:
        known = ipaddress.ip_address(address)
    except ValueError:
        return ""
    if isinstance(known, ipaddress.IPv6Address):
        within = known.ipv4_mapped
        return str(within or ipaddress.ip_network((known, 64), strict=False))
    return address
