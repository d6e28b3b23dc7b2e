"""Access control of the program's servers, by the head of a request, before anything of the request is carried out.

A browser sends requests for any page that it shows, also to 127.0.0.1. It names the host that it believes it speaks to
in `Host`, and the site of the page that asks in `Origin`. A `Host` that is not ours means that a foreign name was made
to point here (DNS rebinding), and an `Origin` other than the host itself means a foreign page. Programs that are no
browsers send no `Origin`; no page can mislead them, and they pass.
"""

from __future__ import annotations

import base64
import hmac
import ipaddress
import secrets
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple
from urllib.parse import urlsplit

from app.process.redaction import new_secret

Pass = Literal["steer", "watch"]


class PortTaken(OSError):
    """An address that the server cannot listen at: one sentence."""


YEAR = 365 * 24 * 3600  # s that a browser keeps a cookie
KEY_HEADER = "X-Vsmrc-Key"
# Our pages are no frame of another page (a click there would be a click here), share no window with the pages that open
# them, and do not pass links, which are secrets, to other servers. Scripts are in the page itself, because viser's
# client is built so; the client also makes functions of text ('unsafe-eval') and a decoder in WebAssembly. No script is
# loaded from another server, and nothing is requested from or sent to one, not even the address of a picture.
PAGE_HEADERS = {
    "Content-Security-Policy": "; ".join(
        (
            "default-src 'self' data: blob:",
            "script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:",
            "style-src 'self' 'unsafe-inline'",
            "object-src 'none'",
            "base-uri 'none'",
            "form-action 'self'",
            "frame-ancestors 'self'",
        )
    ),
    "Cross-Origin-Opener-Policy": "same-origin",
    "Referrer-Policy": "same-origin",
    "Server": "vsmrc-lab",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "SAMEORIGIN",
}
_PORTS = {"http": 80, "https": 443}
_LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})


class RequestRefusal(NamedTuple):
    """A refusal of a request: status of HTTP, and one sentence."""

    status: int
    sentence: str


class OriginError(ValueError):
    """A public address given by `--origin` that is no origin: one sentence."""


@dataclass(frozen=True)
class Names:
    """Names of a server, for the check of `Host` and `Origin`. Raises OriginError.
    host: address that the server listens at.
    public: origins, given by `--origin`, by which a proxy makes the server known, such as https://lab.example.org; in
    lower case and without a "/" at the end once they are in here."""

    host: str = "127.0.0.1"
    public: tuple[str, ...] = ()
    _known: frozenset[str] = field(init=False)

    def __post_init__(self) -> None:
        origins = []
        for origin in self.public:
            if (plain := _origin(origin)) is None:
                raise OriginError(f"origin {origin!r}; allowed: scheme and name, such as https://lab.example.org")
            origins.append(plain)
        object.__setattr__(self, "public", tuple(origins))
        known = _LOOPBACK | {self.host.lower()} | {name for origin in origins if (name := _hostname(origin))}
        if not self.local:  # looked up now: the answer may take the system seconds
            known |= {socket.gethostname().lower(), socket.getfqdn().lower()}
        object.__setattr__(self, "_known", known)

    @property
    def local(self) -> bool:
        """Whether only programs of this machine can reach the server."""
        return is_loopback(self.host)

    def refusal(self, headers: Mapping[str, str], *, acting: bool) -> RequestRefusal | None:
        """Refusal of a request, None for one that may go on. acting: the request changes something here, or opens a web
        socket."""
        host = headers.get("Host", "")
        if not self._ours(_hostname(f"//{host}")):
            return RequestRefusal(
                421, f"Host {host!r:.80} is no name of this server; allowed: its address, or a name given by --origin"
            )
        origin = headers.get("Origin")
        if acting and origin is not None and not self._from_here(origin, host):
            return RequestRefusal(
                403, f"Origin {origin!r:.80} is another page's; allowed: {host!r:.80}, or a page named by --origin"
            )
        return None

    def encrypted(self, host: str) -> bool:
        """Whether a request for this `Host` has come through a proxy with TLS."""
        return _origin(f"https://{host}") in self.public

    def _ours(self, name: str | None) -> bool:
        if name is None:
            return False
        # an address cannot be made to point elsewhere, as a name can
        return name in self._known or (not self.local and _is_address(name))

    def _from_here(self, origin: str, host: str) -> bool:
        """Whether `origin` is a page of this server: one that --origin names, or http and the `Host` of the request,
        unless --origin names that host."""
        plain, own = _origin(origin), _origin(f"http://{host}")
        public = {_hostname(known) for known in self.public}
        return plain is not None and (plain in self.public or (plain == own and _hostname(plain) not in public))


@dataclass(frozen=True)
class Tokens:
    """Tokens that visitors show, each in a link of its own; made at the start and never written to a file."""

    steer: str = field(default_factory=new_secret, repr=False)
    watch: str = field(default_factory=new_secret, repr=False)

    @classmethod
    def given(cls, steer: str) -> Tokens:
        """Tokens of which the one to steer is given. The one to watch is derived from it; nobody can compute the one to
        steer from the one to watch."""
        return cls(steer, _following(steer, "watch"))

    def opens(self, shown: str) -> Pass | None:
        """Pass that this token gives, None for an unknown token."""
        given = shown.encode(errors="surrogateescape")  # a header may hold any bytes
        if secrets.compare_digest(given, self.steer.encode()):
            return "steer"
        return "watch" if secrets.compare_digest(given, self.watch.encode()) else None

    def of(self, kind: Pass) -> str:
        return self.steer if kind == "steer" else self.watch

    def of_session(self, name: str) -> str:
        """Token in the link to steer the session of this name: it opens that session only, as long as the session has
        this name."""
        return _following(self.steer, f"session {name}")

    def opens_session(self, name: str, shown: str) -> bool:
        """Whether this is the token of the session of this name."""
        return secrets.compare_digest(shown.encode(errors="surrogateescape"), self.of_session(name).encode())


def token_cookie(port: int) -> str:
    """Name of the cookie that holds a token, with the port: browsers keep the cookies of all ports of a host
    together."""
    return f"vsmrc-token-{port}"


def session_cookie(port: int) -> str:
    """Name of the cookie that holds the name of the visitor's own session."""
    return f"vsmrc-session-{port}"


def session_token_cookie(port: int) -> str:
    """Name of the cookie that holds the token of one session; a browser keeps one for the path of each session."""
    return f"vsmrc-steer-{port}"


def _following(secret: str, purpose: str) -> str:
    """Secret for a purpose, derived from another secret by HMAC; nobody can compute the other one from it."""
    return base64.urlsafe_b64encode(hmac.digest(secret.encode(), purpose.encode(), "sha256")).decode().rstrip("=")


def is_loopback(host: str) -> bool:
    """Whether a server that listens at this host can be reached from this machine only."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _origin(text: str) -> str | None:
    """Origin of an address: scheme, name and port as a browser writes them, in lower case, without the scheme's usual
    port or a "/" at the end; None for text that is no origin."""
    try:
        parts = urlsplit(text)
        port = parts.port
    except ValueError:
        return None
    if parts.scheme not in _PORTS or not parts.hostname or "@" in parts.netloc:
        return None
    if parts.path.strip("/") or parts.query or parts.fragment:
        return None
    name = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
    return f"{parts.scheme}://{name}" + (f":{port}" if port not in (None, _PORTS[parts.scheme]) else "")


def _hostname(url: str) -> str | None:
    """Host name of an address, in lower case and without the brackets of an IPv6 address; None where there is none."""
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None
