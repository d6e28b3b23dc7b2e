"""Pages of the gateway itself, for visitors who wait or are refused, and its additions to viser's page."""

from __future__ import annotations

import gzip
import hashlib
import io
from dataclasses import dataclass
from functools import cache, lru_cache
from html import escape
from importlib import resources
from string import Template

import segno

_WAITING = """
<div data-phase="starting"><span class="spinner"></span><h1>Your session is being prepared</h1>
<p class="dim">The page comes up by itself; only the very first start on a machine takes half a minute.</p></div>
<div data-phase="waiting" hidden><h1>All places are taken</h1><p>You are number <b class="number" id="place"></b>
in the queue.</p><p class="dim">Leave this page open: it goes on by itself as soon as a place is free. A place that
nobody looks at is given away after <span id="rest"></span> s.</p></div>
<div data-phase="full" hidden><h1>All places are taken</h1><p class="dim">This page tries again.</p></div>
<div data-phase="failed" hidden><h1>This session has stopped</h1>
<p><button id="again">Begin anew</button></p></div>
<div data-phase="lost" hidden><h1>The server does not answer</h1><p class="dim">This page tries again.</p></div>
<p id="why"></p>
<p id="notice"></p>
<script src="../../assets/wait.js"></script>
"""
_CLASS = """
<link rel="stylesheet" href="../../assets/class.css">
<div id="class"><p class="dim">Waiting for the first question…</p></div>
<p id="message" role="status"></p>
<p id="news" role="status" class="unseen"></p>
<script src="../../assets/class.js"></script>
"""
ASSETS = {
    "overlay.js": "text/javascript",
    "overlay.css": "text/css",
    "wait.js": "text/javascript",
    "class.js": "text/javascript",
    "class.css": "text/css",
}


@dataclass(frozen=True)
class Document:
    """A page as it is sent, plain and compressed, and the tag (ETag) of its version."""

    plain: bytes
    compressed: bytes
    tag: str


def waiting() -> str:
    """Page of a session that does not run yet; it reloads by itself."""
    return _page(_WAITING)


def classroom() -> str:
    """Page on which one of a class answers its lecturer's questions."""
    return _page(_CLASS)


@lru_cache(maxsize=64)
def qr(text: str) -> bytes:
    """Picture (SVG) of a QR code of a text. Raises ValueError where it is too long."""
    picture = io.BytesIO()
    segno.make(text, error="m").save(picture, kind="svg", scale=8, border=3, light="#ffffff")
    return picture.getvalue()


def notice(title: str, sentence: str) -> str:
    """Page with a title and one sentence."""
    return _page(f"<h1>{escape(title)}</h1><p>{escape(sentence)}</p>")


def with_overlay(page: bytes) -> Document:
    """viser's page with the gateway's additions, below /s/<name>/ or /watch/<name>/."""
    before, end, after = page.rpartition(b"</head>")
    added = (
        b'<link rel="stylesheet" href="../../assets/overlay.css"><script src="../../assets/overlay.js" defer></script>'
    )
    plain = before + added + end + after
    return Document(plain, gzip.compress(plain, 6), f'"{hashlib.sha256(plain).hexdigest()[:20]}"')


@cache
def asset(name: str) -> bytes:
    """Content of an asset of these pages. Raises KeyError for any other name."""
    if name not in ASSETS:
        raise KeyError(name)
    return _read(name).encode()


def _page(body: str) -> str:
    return Template(_read("page.html")).substitute(body=body)


@cache
def _read(name: str) -> str:
    return resources.files("static").joinpath("gateway", name).read_text(encoding="utf-8")
