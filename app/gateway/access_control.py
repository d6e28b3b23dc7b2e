"""Access control of the gateway: who may come in, who may steer, and who may take links back."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import structlog
from aiohttp import web

from app.access.admission import YEAR, Names, Pass, Tokens, session_token_cookie, token_cookie
from app.access.rate_limits import ConnectionLimits
from app.gateway.responses import notice, without_query
from app.gateway.session import Session
from app.gateway.session_pool import SessionPool
from app.gateway.session_request import is_socket
from app.gateway.visitor_origin import asks_status, is_local, port_of, visitor_cookie, visitor_of
from app.gateway.visitors import Visitor
from app.process.redaction import new_secret

log = structlog.get_logger()

_PASS = web.RequestKey("pass", str)
_GREETING = web.RequestKey("greeting", str)
_QUERIED = ("/about", "/qr")  # what is asked there may stand behind a '?'


@dataclass(frozen=True)
class AccessSettings:
    """Settings of access control.
    names: names of the server.
    tokens: tokens that visitors have to show, None for none.
    everyone: the session that all who may steer share, None when each has one of their own.
    limits: of each connection, and of the pages of a session.
    copies: whether visitors who watch may take a private copy."""

    names: Names
    tokens: Tokens | None = None
    everyone: Session | None = None
    limits: ConnectionLimits = field(default_factory=ConnectionLimits)
    copies: bool = True


class AccessControl:
    """Access control. refusals: number of refused requests, by reason."""

    def __init__(self, settings: AccessSettings, pool: SessionPool, refusals: Counter[str]) -> None:
        self._settings, self._pool, self._refusals = settings, pool, refusals

    def refusal(self, request: web.Request) -> web.StreamResponse | None:
        """Response to a request that is not let in, or is sent on to a cleaner address; None for one that is let in.
        To be asked once for each request, before the methods below; without it nobody steers (a KeyError)."""
        socket = is_socket(request)
        refusal = self._settings.names.refusal(request.headers, acting=socket or request.method not in ("GET", "HEAD"))
        if refusal:
            self._refusals["foreign name or page"] += 1
            log.info("request refused", reason=refusal.sentence)
            return notice("This request is refused", refusal.sentence, refusal.status)
        response = self._without_token(request)
        if response is None and request.query_string and not socket and not request.path.endswith(_QUERIED):
            # viser's page would read another server's address from the query, and run the scripts of that server
            response = without_query(request)
        return self._not_steered(request) if response is None else response

    def steers(self, request: web.Request) -> bool:
        """Whether the visitor may steer every session."""
        return request[_PASS] == "steer"

    def reads_status(self, request: web.Request) -> bool:
        """Whether the visitor may read the state of the server."""
        return self.steers(request) and (self._settings.tokens is not None or is_local(request))

    def _without_token(self, request: web.Request) -> web.StreamResponse | None:
        """Answer to a visitor without a token; None for one who has shown a token, now or before, or need not."""
        tokens = self._settings.tokens
        if tokens is None:
            request[_PASS] = "steer"
            return None
        cookie, token = token_cookie(port_of(request)), request.query.get("token", "")
        known, shown = tokens.opens(request.cookies.get(cookie, "")), tokens.opens(token)
        if of_session := self._opens_session(request, token):
            shown = "watch"  # beside this session, what its link to watch opens, which its page shows
        if asks_status(request):  # as Prometheus shows it
            known = known or tokens.opens(request.headers.get("Authorization", "").removeprefix("Bearer "))
        kind: Pass | None = "steer" if "steer" in (known, shown) else known or shown
        if kind is None and asks_status(request) and is_local(request):
            kind = "steer"  # whoever runs the server, on its machine
        if kind is None:
            self._refusals["no token"] += 1
            log.info("request refused", reason="no token, or a wrong one")
            missing = "this one is not complete, or it was taken back" if token else "as it was printed at the start"
            return notice("Please come in by the link", f"This server needs the link with its token; {missing}.", 403)
        request[_PASS] = kind
        if shown is None or is_socket(request):
            return None
        response = without_query(request)
        self.remember(response, request, cookie, tokens.of(kind))
        if of_session:
            # by default a browser sends it to this session's addresses only, wherever a proxy has put them
            self.remember(response, request, session_token_cookie(port_of(request)), token, path="")
        return response

    def _opens_session(self, request: web.Request, shown: str) -> bool:
        """Whether this is the token to steer the session that is asked for."""
        tokens, name = self._settings.tokens, request.match_info.get("name", "")
        named = request.match_info.get("kind") == "s" and self._pool.named(name) is not None
        return tokens is not None and named and tokens.opens_session(name, shown)

    def _not_steered(self, request: web.Request) -> web.StreamResponse | None:
        """Refusal of a request to steer; None for visitors who may steer (with the pass for it or the session's own
        token, or as the owner of a copy), for requests that do not steer, and where there is no such session."""
        if self.steers(request) or request.match_info.get("kind") != "s":
            return None
        session = self._pool.named(request.match_info["name"])
        shown = (request.query.get("token", ""), request.cookies.get(session_token_cookie(port_of(request)), ""))
        if session is None or self._owns(request, session) or any(self._opens_session(request, s) for s in shown):
            return None
        self._refusals["pass to watch"] += 1
        log.info("request refused", reason="steering asked for with the pass to watch")
        return notice("This link is for steering", "To steer, ask for the link with the token to steer.", 403)

    def _owns(self, request: web.Request, session: Session) -> bool:
        """Whether the session was made for the browser that asks."""
        browser = self.visitor(request).browser
        return bool(browser) and browser == session.owner.browser

    def may_renew(self, request: web.Request, session: Session) -> bool:
        """Whether the visitor may take links back: the owner of the session, and visitors with the token to steer
        everything. Without a token, only the owner, if there is one, so that no guest can."""
        above = self._settings.tokens is not None or not session.owner.browser
        return self._owns(request, session) or (self.steers(request) and above)

    def visitor(self, request: web.Request) -> Visitor:
        """Visitor of a request."""
        return visitor_of(request, self._settings.names)

    def greeted(self, request: web.Request) -> Visitor:
        """Visitor of a request; the answer sets a cookie by which to recognize the browser, unless it has one."""
        visitor = self.visitor(request)
        if not visitor.browser:
            visitor = visitor._replace(browser=new_secret(16))
            request[_GREETING] = visitor.browser
        return visitor

    def keep_greeting(self, response: web.StreamResponse, request: web.Request) -> None:
        """Set the cookie by which a visitor greeted in this request is recognized."""
        if not response.prepared and (greeting := request.get(_GREETING)):
            self.remember(response, request, visitor_cookie(request), greeting)

    def remember(
        self, response: web.StreamResponse, request: web.Request, cookie: str, value: str, path: str = "/"
    ) -> None:
        """Set a cookie that scripts cannot read."""
        secure = request.secure or self._settings.names.encrypted(request.host)
        response.set_cookie(cookie, value, max_age=YEAR, httponly=True, samesite="Lax", secure=secure, path=path)
