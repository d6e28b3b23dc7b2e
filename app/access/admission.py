"""Who may speak to a server of ours: what is judged is the head of a request, before anything of it is carried out.

A browser sends what any page in it asks for, also to 127.0.0.1, and names in `Host` whom it thinks it speaks to and in
`Origin` whose page asks. So a name that is not ours means that a foreign name was made to point here (DNS rebinding),
and an origin that is not the host itself means a foreign page. Other programs name no origin; they are not in
a position to be misled, and pass.
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
    """The address cannot be listened at: one sentence."""


YEAR = 365 * 24 * 3600  # s that a browser keeps a cookie
KEY_HEADER = "X-Vsmrc-Key"
# Our pages are nobody's frame (a click there would be a click here), share no window with the pages that open them, and
# links, which are secrets, are not passed on to other servers. Scripts are in the page itself, as viser's client is
# made, which makes functions of its own text, too, and a decoder in WebAssembly; none is loaded from elsewhere, and
# nothing is asked of or sent to another server, be it a picture's address.
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


class Refusal(NamedTuple):
    """status of HTTP, and one sentence."""

    status: int
    sentence: str


class OriginError(ValueError):
    """A public address that is none: one sentence."""


@dataclass(frozen=True)
class Names:
    """What a server may be called. host: what it listens at; public: origins as `--origin` has them, such as
    https://lab.example.org, by which a proxy makes it known, in lower case and without a "/" at the end once they are
    here. Raises OriginError."""

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
        if not self.local:  # asked for now: to answer may take the system seconds
            known |= {socket.gethostname().lower(), socket.getfqdn().lower()}
        object.__setattr__(self, "_known", known)

    @property
    def local(self) -> bool:
        """Whether only programs of this machine can reach it."""
        return is_loopback(self.host)

    def refusal(self, headers: Mapping[str, str], *, acting: bool) -> Refusal | None:
        """None for a request that may go on. acting: it does something here, or opens a web socket."""
        host = headers.get("Host", "")
        if not self._ours(_hostname(f"//{host}")):
            return Refusal(
                421, f"Host {host!r:.80} is no name of this server; allowed: its address, or a name given by --origin"
            )
        origin = headers.get("Origin")
        if acting and origin is not None and not self._from_here(origin, host):
            return Refusal(
                403, f"Origin {origin!r:.80} is another page's; allowed: {host!r:.80}, or a page named by --origin"
            )
        return None

    def encrypted(self, host: str) -> bool:
        """Whether who asks for this `Host` has come through a proxy with TLS."""
        return _origin(f"https://{host}") in self.public

    def _ours(self, name: str | None) -> bool:
        if name is None:
            return False
        # an address cannot be made to point elsewhere, as a name can
        return name in self._known or (not self.local and _is_address(name))

    def _from_here(self, origin: str, host: str) -> bool:
        """Scheme, name and port are those of the page itself: of a public name as --origin has them, else http."""
        plain, own = _origin(origin), _origin(f"http://{host}")
        public = {_hostname(known) for known in self.public}
        return plain is not None and (plain in self.public or (plain == own and _hostname(plain) not in public))


@dataclass(frozen=True)
class Tokens:
    """What a visitor shows at the door, each by a link of its own; made at the start and never written to a file."""

    steer: str = field(default_factory=new_secret, repr=False)
    watch: str = field(default_factory=new_secret, repr=False)

    @classmethod
    def given(cls, steer: str) -> Tokens:
        """With this one to steer; the other one follows from it, and it not from the other one."""
        return cls(steer, _following(steer, "watch"))

    def opens(self, shown: str) -> Pass | None:
        """What this token allows, None for one that is not ours."""
        given = shown.encode(errors="surrogateescape")  # a header may hold any bytes
        if secrets.compare_digest(given, self.steer.encode()):
            return "steer"
        return "watch" if secrets.compare_digest(given, self.watch.encode()) else None

    def of(self, kind: Pass) -> str:
        return self.steer if kind == "steer" else self.watch

    def of_session(self, name: str) -> str:
        """What the link to steer the session of this name has: it opens that one only, while it is called so."""
        return _following(self.steer, f"session {name}")

    def opens_session(self, name: str, shown: str) -> bool:
        """Whether this is the token of the session of this name."""
        return secrets.compare_digest(shown.encode(errors="surrogateescape"), self.of_session(name).encode())


def token_cookie(port: int) -> str:
    """The name of the cookie that holds a token: browsers keep those of all ports of a host together."""
    return f"vsmrc-token-{port}"


def session_token_cookie(port: int) -> str:
    """The name of the cookie that holds the token of one session; a browser keeps one below each session's path."""
    return f"vsmrc-steer-{port}"


def _following(secret: str, purpose: str) -> str:
    """A secret that follows from this one, and from which this one does not follow."""
    return base64.urlsafe_b64encode(hmac.digest(secret.encode(), purpose.encode(), "sha256")).decode().rstrip("=")


def is_loopback(host: str) -> bool:
    """Whether what listens there can be reached from this machine only."""
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
    """Scheme, name and port as a browser writes them: in lower case, without the scheme's usual port or a "/" at the
    end; None for what is no such thing."""
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
    """In lower case and without the brackets of an IPv6 address; None where there is none."""
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None
