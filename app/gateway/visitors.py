"""Visitors of a gateway, and their shares: limits of one visitor, so that nobody uses up what all share."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import NamedTuple

from app.access.admission import Pass


class Visitor(NamedTuple):
    """A visitor, as far as visitors can be told apart.
    browser: the random word of its cookie.
    address: of its machine, or of its network where one has many.
    Each is "" where it is unknown, and then it is not counted."""

    browser: str = ""
    address: str = ""

    @property
    def marks(self) -> tuple[str, ...]:
        """Hashes of browser and address, for files: equal for the same browser and for the same address, from which
        neither can be read."""
        known = (("browser", self.browser), ("address", self.address))
        return tuple(hashlib.sha256(f"{kind} {word}".encode()).hexdigest()[:16] for kind, word in known if word)


NOBODY = Visitor()


class Viewer(NamedTuple):
    """An open page: its visitor, and what it may do."""

    visitor: Visitor
    kind: Pass


class VisitorLimit(NamedTuple):
    """Limits of the number of `what`: of one browser, of one address, and in all."""

    what: str
    browser: int
    address: int
    total: int

    def refusal(self, asking: Visitor, holders: Iterable[Visitor]) -> str:
        """Reason why this visitor may have no more beside those of the holders; "" where it may."""
        every = list(holders)
        near = sum(holder.address == asking.address for holder in every) if asking.address else 0
        own = sum(holder.browser == asking.browser for holder in every) if asking.browser else 0
        if own >= self.browser:
            return f"{own} {self.what} of one browser; allowed: no more"
        if near >= self.address:
            return f"{near} {self.what} of one address; allowed: no more"
        return f"{len(every)} {self.what}; allowed: no more" if len(every) >= self.total else ""


class VisitorLimits(NamedTuple):
    """Limits of a gateway. Pages that steer have a budget of their own, which those that watch cannot use up: of each
    session, and of the server.
    link_copies: copies of one session. Copies and sessions that wait count as long as somebody asks for them."""

    steering: VisitorLimit = VisitorLimit("pages that steer this session", 8, 12, 16)
    watching: VisitorLimit = VisitorLimit("pages that watch this session", 6, 32, 48)
    all_watching: VisitorLimit = VisitorLimit("pages that watch sessions of this server", 24, 96, 192)
    pages: VisitorLimit = VisitorLimit("pages of this server", 32, 192, 256)
    copies: VisitorLimit = VisitorLimit("private copies", 4, 32, 256)
    link_copies: VisitorLimit = VisitorLimit("private copies of this session", 64, 64, 64)
    waiting: VisitorLimit = VisitorLimit("sessions that wait for a place", 3, 64, 500)


def visitor_limit(capacity: int, of_one_address: int | None) -> VisitorLimit:
    """Shares of the sessions that may run: a browser may have half of them, but always two; an address may have
    three quarters, or `of_one_address` where this is given."""
    address = of_one_address or max(1, capacity - max(1, capacity // 4))
    return VisitorLimit("sessions that run", max(2, capacity // 2), address, capacity)
