"""Values that pages give to widgets, apart from those that this program sets.

viser's `on_update` calls back for both, and makes a task of its event loop of every call. For a value that the program
has set there is nothing to do, and at the end of the loop its task would never run.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Coroutine
from typing import Any, Protocol

import viser


class PageEvent(Protocol):
    """Event: a page has given a widget another value.
    client: that page.
    target: the widget."""

    @property
    def client(self) -> viser.ClientHandle: ...

    @property
    def target(self) -> Any: ...


class _FromPages(functools.partial[Coroutine[Any, Any, None]]):
    """Callback of `on_update`. A `partial`, because viser takes that of a coroutine function for a coroutine function,
    which it awaits at once where a page has given the value."""

    def __call__(self, /, event: Any) -> Any:
        return None if event.client is None else super().__call__(event)


def from_pages(callback: Callable[[PageEvent], Coroutine[Any, Any, None]]) -> Callable[[viser.GuiEvent[Any]], Any]:
    """Callback for `on_update` that calls the given one for the values of pages only."""
    return _FromPages(callback)
