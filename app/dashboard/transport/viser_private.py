"""Private parts of viser that this program uses, all of them here: `pyproject.toml` pins viser for their sake.

Each function says which public way is missing.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, cast

import numpy as np
import viser
from viser._gui_handles import GuiFormHandle
from viser._messages import GuiUpdateMessage, SetOrientationMessage, SetPositionMessage
from viser.infra import WebsockClientConnection, WebsockMessageHandler
from websockets.asyncio.server import ServerConnection

Handler = Callable[..., Any]
STILL = 1e-6  # m, and parts of a quaternion: no picture shows less


def connections(server: viser.ViserServer) -> dict[int, ServerConnection]:
    """Web sockets of the pages, by the number of their clients. Missing: a `ClientHandle` does not give its web
    socket."""
    return dict(server._websock_server._live_connections)


def on_connection(server: viser.ViserServer, callback: Callable[[ServerConnection, int], None]) -> None:
    """Call `callback` with the web socket of every page, also of those that are open already, and its client's number.

    Missing: `ViserServer.on_client_connect` is called only after messages of the page have been read.
    """
    websock = server._websock_server

    async def on_connect(client: WebsockClientConnection) -> None:
        connection = websock._live_connections.get(client.client_id)
        if connection is not None:
            callback(connection, client.client_id)

    websock.on_client_connect(on_connect)
    for number, connection in list(websock._live_connections.items()):
        callback(connection, number)


class _SetInLoop(asyncio.Event):
    """Event that is set in its loop's thread only; `set` in another thread does nothing."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._loop_of_waiters = loop

    def set(self) -> None:
        try:
            here = asyncio.get_running_loop()
        except RuntimeError:  # this thread has no event loop
            return
        if here is self._loop_of_waiters:
            super().set()


def let_any_thread_send(server: viser.ViserServer) -> None:
    """Let the events by which viser hears of new messages be set in the thread of viser's event loop only.

    Missing: viser also sets them in the thread that sends a message. If the event loop changes the list of waiting
    tasks at that time, the sender fails with "deque mutated during iteration".
    """

    def mend(messages: WebsockMessageHandler) -> None:
        buffer = messages.get_message_buffer()
        present = buffer.message_event
        buffer.message_event = _SetInLoop(buffer.event_loop)
        buffer.event_loop.call_soon_threadsafe(present.set)  # wakes the tasks that wait for the replaced event

    mend(server._websock_server)
    server._websock_server.on_client_connect(mend)


def wrap_updates(server: viser.ViserServer, wrap: Callable[[Handler], Handler]) -> None:
    """Wrap the functions by which viser handles a widget's new value. Missing: `on_update` is called only after the
    value has been written."""
    handlers = server._websock_server._incoming_handlers
    handlers[GuiUpdateMessage] = [wrap(handler) for handler in handlers[GuiUpdateMessage]]


def forget_uploads(server: viser.ViserServer, uploads: set[str]) -> None:
    """Remove the receipts of these uploads from the messages kept for later pages. Missing: nothing public removes
    them."""
    server._websock_server.get_message_buffer().remove_from_buffer(
        lambda message: getattr(message, "transfer_uuid", None) in uploads
    )


def widget_of(server: viser.ViserServer, client: int, uuid: str) -> Any:
    """Widget of this name that all clients or this one have, None without one. Missing: handles are given when they are
    made, and cannot be looked up by the name in a page's messages."""
    page = server.get_clients().get(client)
    own = None if page is None else page.gui._gui_input_handle_from_uuid.get(uuid)
    return server.gui._gui_input_handle_from_uuid.get(uuid, own)


def is_form(server: viser.ViserServer, uuid: str) -> bool:
    """Whether the container of this name, which all clients share, is a form. Missing: handles cannot be looked up by
    name."""
    return isinstance(server.gui._container_handle_from_uuid.get(uuid), GuiFormHandle)


def uuid_of(handle: viser.GuiInputHandle[Any]) -> str:
    """Name of a widget in a page's messages. Missing: a handle does not give it."""
    return handle._impl.uuid


def move(node: viser.SceneNodeHandle, position: np.ndarray, wxyz: np.ndarray | None = None) -> None:
    """Move a node to position (3,) m and turn it to wxyz (4,), each unless it is there within `STILL`. Missing: the
    public setters compare by `np.allclose`, which took half the time of a frame."""
    known = node._impl
    for present, wanted, message in (
        (known.position, position, SetPositionMessage),
        (known.wxyz, known.wxyz if wxyz is None else wxyz, SetOrientationMessage),
    ):
        if np.abs(wanted - present).max() > STILL:
            present[:] = wanted
            known.api._queue_scene_message(message(known.name, tuple(wanted.tolist())))


def draw_points(node: viser.ArrowsHandle | viser.LineSegmentsHandle, points: np.ndarray) -> None:
    """Draw arrows or segments between these points (N, 2, 3) m, unless each is there within `STILL`. Missing: the
    public setter compares for equality, and looks up types anew."""
    props, wanted = node._impl.props, points.astype(np.float32)
    present = props.points
    if present.shape != wanted.shape or not np.abs(wanted - present).max() <= STILL:
        props.points = wanted
        node._queue_update("points", wanted)


def whole_plot(chart: viser.GuiUplotHandle, data: tuple[np.ndarray, ...], count: int, base: dict[str, Any]) -> None:
    """Give a chart its whole data: arrays (N,), in single precision, which is enough for pixels and half as many bytes.
    count: number of arrays; those beyond `data` are sent as empty lists, of a byte each.
    base: properties that `further_points` refers to.
    Missing: the public setter casts to double precision, looks up the type of every array anew, and takes no list."""
    lean = (*(values.astype(np.float32) for values in data), *((),) * (count - len(data)))
    cast(Any, chart._impl.props).data = lean
    _update(chart, {"data": lean, "value": base})


def further_points(chart: viser.GuiUplotHandle, points: dict[str, Any]) -> int:
    """Send changes of a chart's data, which the page's script makes whole (`static/page/points.js`). Returns the
    message's number. Missing: viser sends whole arrays only. The changes travel as the chart's `value`, which viser
    does not use and a page without the script ignores."""
    _update(chart, {"value": points})
    return chart._impl.gui_api._websock_interface.get_message_buffer().message_counter - 1


def is_with_all(chart: viser.GuiUplotHandle, number: int) -> bool:
    """Whether the message of this number is on its way to every page, so that no later message can replace it. Missing:
    nothing public tells which messages have been sent."""
    cursors = chart._impl.gui_api._websock_interface.get_message_buffer().generator_cursors
    return all(cursor >= number for cursor in tuple(cursors.values()))


def _update(chart: viser.GuiUplotHandle, updates: dict[str, Any]) -> None:
    chart._impl.gui_api._websock_interface.queue_message(GuiUpdateMessage(chart._impl.uuid, updates))
