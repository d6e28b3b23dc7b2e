"""Responses of the gateway: their kinds, and the same headers on all of them, also on those to requests that are no
HTTP, whose content is not logged."""

from __future__ import annotations

import structlog
from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError
from aiohttp.web_protocol import RequestHandler

from app.access.admission import PAGE_HEADERS
from app.gateway import pages

log = structlog.get_logger()


async def with_headers(_: web.BaseRequest, response: web.StreamResponse) -> None:
    """Add the headers to a response before it is sent, also to those of web sockets."""
    response.headers.update(PAGE_HEADERS)
    response.headers.setdefault("Cache-Control", "no-store")


def without_query(request: web.Request) -> web.Response:
    """Redirect to the same page, without the part of the address behind the '?'."""
    return web.Response(status=303, headers={"Location": f"./{request.rel_url.raw_path.rpartition('/')[2]}"})


def html(text: str, status: int = 200) -> web.Response:
    """Response with a page."""
    return web.Response(text=text, status=status, content_type="text/html")


def notice(title: str, sentence: str, status: int) -> web.Response:
    """Response with a page that tells one sentence."""
    return html(pages.notice(title, sentence), status)


def session_page(document: pages.Document, request: web.Request) -> web.Response:
    """Response with a session's page: compressed where the browser can read that, nothing where it has the page."""
    headers = {"ETag": document.tag, "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
    if document.tag in request.headers.get("If-None-Match", ""):
        return web.Response(status=304, headers=headers)
    if "gzip" in request.headers.get("Accept-Encoding", ""):
        headers["Content-Encoding"] = "gzip"
        return web.Response(body=document.compressed, content_type="text/html", charset="utf-8", headers=headers)
    return web.Response(body=document.plain, content_type="text/html", charset="utf-8", headers=headers)


class ApplicationRunner(web.AppRunner):
    """Runs an application whose connections are `_Connection`s; aiohttp has no setting for that."""

    async def _make_server(self) -> web.Server:
        server = await super()._make_server()
        server.__class__ = _Server
        return server


class _Server(web.Server):
    def __call__(self) -> RequestHandler:
        return _Connection(self, loop=self._loop, **self._kwargs)


class _Connection(RequestHandler):
    """A connection that answers a fault in a sentence. aiohttp would log, and send back, what it could not read: whole
    header lines, with the cookies in them."""

    __slots__ = ()

    def handle_error(
        self,
        request: web.BaseRequest,
        status: int = 500,
        exc: BaseException | None = None,
        message: str | None = None,
    ) -> web.StreamResponse:
        del message
        if isinstance(exc, HttpProcessingError):
            log.info("request refused", reason=f"no HTTP: {type(exc).__name__}")
            page = pages.notice("This request is refused", "It is no HTTP as this server reads it.")
        elif isinstance(exc, ConnectionError) and (request.transport is None or request.transport.is_closing()):
            log.debug("visitor gone before the answer")  # no fault: a page was left while it loaded
            page = ""
        else:
            log.error("fault", stage="a request", exc_info=exc)
            page = pages.notice("This server has made a mistake", "The sessions go on.")
        if request.writer.output_size > 0:
            raise ConnectionError("an answer has been begun: there can be no other one")
        response = web.Response(text=page, status=status, content_type="text/html", headers=PAGE_HEADERS)
        response.force_close()
        return response
