"""For whom a server is: plain settings, so that who is alone need not load the gateway."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from app.access.admission import Names, Tokens

Token = Literal["auto", "always", "never"]


@dataclass(frozen=True)
class Look:
    """How the pages of all sessions look at first, and pictures of the scene per second."""

    theme: str = "dark"
    fps: float = 30.0


@dataclass(frozen=True)
class ServerSettings:
    """Settings of a server: to whom it is open.

    shared: a session for each visitor, else one for all; token: asked for where others than this user's programs can
    come (auto); given: the token to steer, None for a fresh one; crowded: other people are on this machine; origins:
    public addresses behind a proxy; places: sessions that run at once, None for what this machine holds;
    of_one_address: how many of them, None for all but a quarter; copies: whether who watches may take a private one;
    idle_minutes: after which a session that nobody looks at is closed.
    """

    host: str = "127.0.0.1"
    port: int = 8080
    shared: bool = False
    token: Token = "auto"
    origins: tuple[str, ...] = ()
    places: int | None = None
    of_one_address: int | None = None
    copies: bool = True
    idle_minutes: float = 30.0
    given: str | None = field(default=None, repr=False)
    crowded: bool = False

    @property
    def open(self) -> bool:
        """Whether a gateway is needed at all."""
        others = bool(self.origins) or not Names(self.host).local
        return self.shared or others or self.token == "always" or self.given is not None

    @property
    def tokens(self) -> Tokens | None:
        """What visitors have to show, None for nothing."""
        if self.given is not None:
            return Tokens.given(self.given)
        asks = self.token == "always" or self.crowded or bool(self.origins) or not Names(self.host).local
        return Tokens() if asks and self.token != "never" else None
