"""Settings of a server, as plain data, so that a server for one user need not load the gateway."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from app.access.admission import Tokens, is_loopback

Token = Literal["auto", "always", "never"]


@dataclass(frozen=True)
class PageStyle:
    """Style of the pages of all sessions at first: theme, and pictures of the scene per second."""

    theme: str = "dark"
    fps: float = 30.0


@dataclass(frozen=True)
class ServerSettings:
    """Settings of a server: to whom it is open, and how much it serves.

    shared: a session for each visitor, else one for all.
    token: whether a token is asked for; "auto": where other programs than this user's can connect.
    given: the token to steer, None for a fresh one.
    crowded: other people are on this machine.
    origins: public addresses behind a proxy.
    capacity: sessions that run at once, None for as many as this machine can run.
    of_one_address: how many of them one address may have, None for all but a quarter.
    copies: whether visitors who watch may take a private copy.
    classes: whether lessons may ask a class, by a link of its own.
    idle_minutes: time after which a session that nobody looks at is closed.
    """

    host: str = "127.0.0.1"
    port: int = 8080
    shared: bool = False
    token: Token = "auto"
    origins: tuple[str, ...] = ()
    capacity: int | None = None
    of_one_address: int | None = None
    copies: bool = True
    classes: bool = False
    idle_minutes: float = 30.0
    given: str | None = field(default=None, repr=False)
    crowded: bool = False

    @property
    def open(self) -> bool:
        """Whether a gateway is needed."""
        others = bool(self.origins) or not is_loopback(self.host)
        return self.shared or self.classes or others or self.token == "always" or self.given is not None

    def new_tokens(self) -> Tokens | None:
        """Tokens that visitors have to show, drawn anew unless they are given; None for none."""
        if self.given is not None:
            return Tokens.given(self.given)
        asks = self.token == "always" or self.crowded or bool(self.origins) or not is_loopback(self.host)
        return Tokens() if asks and self.token != "never" else None
