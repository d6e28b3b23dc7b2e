"""From a slider's message to the first control step that uses it.

A bare client sends the message as the page would, so that the moment of sending is known, while the page is open too
(or not). The server notes when the first step with the new value has been computed.
"""

from __future__ import annotations

import contextlib
import random
import threading
import time

import msgspec
import numpy as np
import viser
from tqdm import tqdm
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from app.markdown import Table
from benchmarks.browser import chromium, messages, opened
from benchmarks.effort import Effort
from benchmarks.served import Served, served

SCENARIO, LABEL, SCALE = "ur5-hybrid", "F_d [N]", 60.0  # the slider's right end, N
LOWEST, STEP = 10.0, 0.1  # N: every message asks for a value of its own, one step above the one before
PAUSES = (0.04, 0.08)  # s between two messages: about as fast as the page sends them, at no fixed phase
GRACE = 1.0  # s: the last message's step is computed by then
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.0, 1.0, 1.0),
    "fov": 1.0,
    "near": 0.1,
    "far": 10.0,
    "image_height": 720,
    "image_width": 1280,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}  # viser counts a client as connected once it has told its camera


def measure(effort: Effort) -> Table:
    """The table of latencies."""
    rows = []
    with served(SCENARIO) as dashboard, _client(dashboard.url) as socket:
        slider = _slider(socket)
        threading.Thread(target=_read_on, args=(socket,), daemon=True).start()
        rows.append(("without a page", *_shown(_latencies(dashboard, socket, slider, effort.messages))))
        with chromium() as browser:
            opened(browser, dashboard.url)
            rows.append(("with a page", *_shown(_latencies(dashboard, socket, slider, effort.messages))))
    return Table(("from a slider's message to its step", "messages", "p50, ms", "p99, ms", "max, ms"), rows)


def _latencies(dashboard: Served, socket: ClientConnection, slider: str, count: int) -> np.ndarray:
    """(count,) s. A message that a later one overtakes in the server's queue is used where that one is.

    Raises RuntimeError when the last one was not used.
    """
    chance, began = random.Random(0), time.perf_counter()
    values, sent = LOWEST + STEP * np.arange(count), np.empty(count)
    for k in tqdm(range(count), desc="messages", leave=False, disable=None):
        sent[k] = time.perf_counter()
        _send(socket, {"type": "GuiUpdateMessage", "uuid": slider, "updates": {"value": float(values[k] / SCALE)}})
        time.sleep(chance.uniform(*PAUSES))
    time.sleep(GRACE)
    uses = [use for use in dashboard.uses() if use.computed > began]
    first = np.searchsorted([use.value for use in uses], values - STEP / 2)
    if first[-1] == len(uses):
        raise RuntimeError(f"the slider's last value, {values[-1]:.1f} N, did not reach the loop")
    return np.array([uses[i].computed for i in first]) - sent


def _shown(latencies: np.ndarray) -> tuple[str, ...]:
    p50, p99 = np.percentile(latencies, (50, 99)) * 1e3
    return str(len(latencies)), f"{p50:.1f}", f"{p99:.1f}", f"{latencies.max() * 1e3:.1f}"


def _client(url: str) -> ClientConnection:
    protocol = Subprotocol(f"viser-v{viser.__version__}")
    return connect(url.replace("http", "ws"), subprotocols=[protocol], max_size=None, compression=None)


def _slider(socket: ClientConnection) -> str:
    """The identifier of the slider in the row labelled `LABEL`. It comes after the row's text.

    On the way previews are switched off, with which a slider would be applied only when it is let go.
    """
    _send(socket, CAMERA)
    row: str | None = None
    while True:
        for message in messages(bytes(socket.recv(timeout=30.0))):
            if message["type"] == "GuiCheckboxMessage" and message["props"]["label"] == "Preview":
                _send(socket, {"type": "GuiUpdateMessage", "uuid": message["uuid"], "updates": {"value": False}})
            if message["type"] == "GuiTextMessage" and message["props"]["label"] == LABEL:
                row = message["container_uuid"]
            if message["type"] == "GuiSliderMessage" and message["container_uuid"] == row:
                return message["uuid"]


def _read_on(socket: ClientConnection) -> None:
    """Take what the server sends, so that it need not wait for this client."""
    with contextlib.suppress(ConnectionClosed):
        while True:
            socket.recv()


def _send(socket: ClientConnection, message: dict) -> None:
    socket.send(msgspec.msgpack.encode(message))
