"""Pages of a class: the questions of a lesson, for whoever may watch the session.

/class/NAME/         the page; NAME is that of /watch/
/class/NAME/question the present question, as JSON
/class/NAME/answer   POST: the answer to it, as JSON
"""

from __future__ import annotations

import asyncio
from collections import Counter
from typing import Any

import msgspec
from aiohttp import web

from app.access.classroom import AnswerRefusal
from app.access.session_messages import Answers
from app.gateway import pages
from app.gateway.access_control import AccessControl
from app.gateway.connections import DEADLINE
from app.gateway.responses import html
from app.gateway.session import Session
from app.gateway.session_pool import SessionPool
from app.gateway.session_request import session_of
from app.process.json_text import decode_json

GATHERED = 0.1  # s that answers of a class wait for others: each time all of them are handed over


class ClassPages:
    """Pages of the classes. refusals: number of refused requests, by reason."""

    def __init__(self, pool: SessionPool, access: AccessControl, refusals: Counter[str]) -> None:
        self._pool, self._access, self._refusals = pool, access, refusals

    @property
    def routes(self) -> list[web.RouteDef]:
        return [
            web.get("/class/{name}", self._page),
            web.get("/class/{name}/", self._page),
            web.get("/class/{name}/question", self._question),
            web.post("/class/{name}/answer", self._answer),
        ]

    async def _page(self, request: web.Request) -> web.StreamResponse:
        self._of_class(request)
        if not request.path.endswith("/"):
            return web.Response(status=303, headers={"Location": f"{request.match_info['name']}/"})
        self._access.greeted(request)
        return html(pages.classroom())

    async def _question(self, request: web.Request) -> web.StreamResponse:
        """Response with the present question of a class, and the visitor's own answer to it."""
        session = self._of_class(request)
        own = session.classroom.own(self._access.greeted(request).browser)
        return web.json_response({"question": msgspec.to_builtins(session.classroom.question), "own": own})

    async def _answer(self, request: web.Request) -> web.StreamResponse:
        session, visitor = self._of_class(request), self._access.visitor(request)
        classroom = session.classroom
        try:
            async with asyncio.timeout(DEADLINE):
                body = await request.read()
        except TimeoutError:
            raise web.HTTPRequestTimeout from None
        except web.HTTPRequestEntityTooLarge as error:
            return web.json_response({"refused": "answer: too long; allowed: at most 64 kB"}, status=error.status)
        self._of_class(request)  # the link may have been taken back meanwhile
        try:
            answer = decode_json(body, dict[str, Any])
        except ValueError as error:
            return web.json_response({"refused": f"answer: {error}"}, status=400)
        try:
            classroom.give(visitor.browser, visitor.address, answer.get("number"), answer.get("given"))
        except AnswerRefusal as error:
            self._refusals["answers of a class"] += 1
            return web.json_response({"refused": str(error)}, status=409)
        if not session.hands_over_soon:
            session.hands_over_soon = True
            asyncio.get_running_loop().call_later(GATHERED, _hand_over, session)
        return web.json_response({"own": classroom.own(visitor.browser)})

    def _of_class(self, request: web.Request) -> Session:
        """Session whose class is meant. Raises HTTPNotFound, also where there are no classes."""
        if not self._pool.classes:
            raise web.HTTPNotFound
        return session_of(request, self._pool)


def _hand_over(session: Session) -> None:
    """Hand the answers of a session's class to its process."""
    session.hands_over_soon = False
    if session.process is not None and session.classroom.question is not None:
        session.process.answer(Answers(session.classroom.number, session.classroom.given))
