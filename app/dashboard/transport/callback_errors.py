"""Errors in callbacks of the page: each becomes a sentence on the page and a line in the log.

viser's asynchronous callbacks are tasks of its event loop, which `watch` guards as a whole. Errors of callbacks that
viser calls from a thread of its pool, or one after the other (drags in the scene), it would only print: these callbacks
are `guarded` singly.
"""

from __future__ import annotations

import asyncio
import functools
from collections.abc import Awaitable, Callable
from typing import Any

import structlog

log = structlog.get_logger()

Complain = Callable[[str], None]
_OURS = "app."


class Fault(str):
    """Sentence on a failure: of this program, of a disk, or of a job. Whoever gets complaints shows it as such, other
    sentences as refusals of what the user has asked for."""


def watch(loop: asyncio.AbstractEventLoop, complain: Complain) -> None:
    """Report exceptions of this event loop from now on. Exceptions outside of this program's code, as by a client's
    garbage, are only logged."""

    def report(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        if isinstance(error, Exception) and _is_ours(error):
            _failed(error, complain)
        else:
            log.info("message dropped", reason=context["message"], error=f"{type(error).__name__}: {error}")
            log.debug("where it was dropped", exc_info=error)

    loop.call_soon_threadsafe(loop.set_exception_handler, report)


def guarded(callback: Callable[..., Any], complain: Complain) -> Callable[..., Any]:
    """Callback that calls the given one, and reports its exceptions instead of raising them."""
    if asyncio.iscoroutinefunction(callback):

        @functools.wraps(callback)
        async def waiting(*what: Any) -> None:
            try:
                pending: Awaitable[None] = callback(*what)
                await pending
            except Exception as error:
                _failed(error, complain)

        return waiting

    @functools.wraps(callback)
    def calling(*what: Any) -> None:
        try:
            callback(*what)
        except Exception as error:
            _failed(error, complain)

    return calling


def _failed(error: Exception, complain: Complain) -> None:
    log.error("fault", stage="a callback of the page", exc_info=error)
    complain(Fault(f"the page could not carry that out ({type(error).__name__}: {error}); the run goes on"))


def _is_ours(error: Exception) -> bool:
    """Whether the exception passed through this program's code."""
    trace = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_globals.get("__name__", "").startswith(_OURS):
            return True
        trace = trace.tb_next
    return False
