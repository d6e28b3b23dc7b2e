"""Visitors of a server of this program: pages without a browser, with the protocol of viser's client."""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple
from urllib.parse import urlsplit

import msgspec
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from drivers.viser_protocol import CAMERA, PROTOCOL, messages

_PANEL = re.compile(r'class="vs-panel" data-plots="([^"]*)"')
_RUNNING = re.compile(r'class="vs-status"[^>]* data-phase="running"')
_FAULT = re.compile(r' event=(fault|"thread failed") |^Traceback ', re.MULTILINE)  # as the log has them
PATIENCE = 180.0  # s; on an idle machine, a wait takes a fraction of a second


class VisitingPage:
    """Visitor: an open page, with the content of its control panel as received, and its actions."""

    def __init__(self, socket: Connection) -> None:
        self._socket = socket
        self.html: dict[str, str] = {}
        self.commands: dict[str, str] = {}
        self.buttons: dict[str, str] = {}
        self.received = 0
        self._report_field = ""  # field in which a page reports its visible tabs: the first one without a label
        self._news = threading.Condition()
        self._ended: ConnectionClosed | None = None
        threading.Thread(target=self._listen, daemon=True).start()
        self.send(CAMERA)

    def send(self, message: dict[str, Any] | bytes) -> None:
        self._socket.send(message if isinstance(message, bytes) else msgspec.msgpack.encode(message))

    def trigger(self, command: str) -> None:
        """Choose the command with this title. Raises AssertionError where the page has none."""
        self.wait(
            lambda: command in self.commands, describe=lambda: f"{command!r} is not among {sorted(self.commands)}"
        )
        self.send({"type": "CommandTriggerMessage", "uuid": self.commands[command]})

    def press(self, button: str) -> None:
        """Press the button that was created with this label. Raises AssertionError where the page has none."""
        self.wait(lambda: button in self.buttons, describe=lambda: f"{button!r} is not among {sorted(self.buttons)}")
        self.send({"type": "GuiUpdateMessage", "uuid": self.buttons[button], "updates": {"value": True}})

    @property
    def status(self) -> str:
        """Text of the status line."""
        found = [re.sub(r"<[^>]+>", " ", html) for html in self.html.values() if "vs-status" in html]
        return " ".join(found).strip()

    @property
    def running(self) -> bool:
        """Whether the page shows a running loop."""
        return any(_RUNNING.search(html) for html in self.html.values())

    def look_at(self, tab: str) -> None:
        """Report that this tab of plots and the first one of controls are visible, as the page's script does."""
        self.wait(lambda: self._report_field != "" and self._controls != "")
        seen = f"{tab},{self._controls}##"
        self.send({"type": "GuiUpdateMessage", "uuid": self._report_field, "updates": {"value": seen}})

    @property
    def _controls(self) -> str:
        """Name of the first tab of controls, "" before it has come."""
        return next((found[1] for html in self.html.values() if (found := _PANEL.search(html))), "")

    @property
    def text(self) -> str:
        """Whole text of the panel."""
        return " ".join(self.html.values())

    @property
    def t(self) -> float:
        """Simulated time on the page, s."""
        found = re.search(r"\bt\s+([\d.]+)\s+s", self.status)
        return float(found[1]) if found else -1.0

    def wait(
        self, condition: Callable[[], bool], seconds: float = PATIENCE, describe: Callable[[], str] | None = None
    ) -> None:
        """Wait until the condition holds. Raises ConnectionClosed, and AssertionError when the time is over.
        describe: returns the text of the AssertionError, None for the status line."""
        with self._news:
            self._news.wait_for(lambda: condition() or self._ended is not None, seconds)
            if condition():
                return
            if self._ended is not None:
                raise self._ended
        raise AssertionError(describe() if describe else self.status[-400:])

    def lose(self) -> None:
        """Wait until the server closes the connection. Raises ConnectionClosed then."""
        self.wait(lambda: False)

    def _listen(self) -> None:
        """Receive messages all the time, as a browser does: a client that does not answer a ping counts as gone."""
        try:
            while True:
                frame = self._socket.recv()
                assert isinstance(frame, bytes)
                with self._news:
                    self.received += len(frame)
                    for message in messages(frame):
                        self.take(message)
                    self._news.notify_all()
        except ConnectionClosed as ended:
            with self._news:
                self._ended = ended
                self._news.notify_all()

    def take(self, message: dict[str, Any]) -> None:
        """Take up a message of the server, while nobody waits for the page's news."""
        if message["type"] == "GuiHtmlMessage":
            self.html[message["uuid"]] = message["props"]["content"]
        elif message["type"] == "GuiUpdateMessage" and "content" in message["updates"]:
            self.html[message["uuid"]] = message["updates"]["content"]
        elif message["type"] == "GuiTextMessage" and not message["props"]["label"]:
            self._report_field = self._report_field or message["uuid"]
        elif message["type"] == "GuiButtonMessage":
            self.buttons[message["props"]["label"]] = message["uuid"]
        elif message["type"] == "RegisterCommandMessage":
            self.commands[message["props"]["label"]] = message["uuid"]


@contextmanager
def visiting(url: str, **options: Any) -> Iterator[VisitingPage]:
    """Context with a page that is open at this address. options: of the web socket."""
    with connected(url, **options) as socket:
        yield VisitingPage(socket)


@contextmanager
def connected(url: str, **options: Any) -> Iterator[Connection]:
    """Context with a web socket that is open at a page's address. options: of the web socket."""
    address = url.replace("http", "ws", 1).rstrip("/")
    usual = {
        "subprotocols": [PROTOCOL],
        "compression": None,
        "max_size": None,
        "open_timeout": PATIENCE,
        "ping_interval": None,
    }
    with connect(address, **usual | options) as socket:
        assert socket.subprotocol == PROTOCOL
        yield socket


class Server(NamedTuple):
    """Server: a running `vsmrc serve`. lines: those that it has printed."""

    process: subprocess.Popen[str]
    lines: list[str]

    @property
    def url(self) -> str:
        """Printed address, with its token."""
        return self.lines[0].split()[2]

    @property
    def port(self) -> int:
        return urlsplit(self.url).port or 0

    def children(self) -> list[int]:
        """Numbers of the server's child processes that have not ended, in the order of their start."""
        pid = self.process.pid
        return [int(number) for number in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


@contextmanager
def serving(*arguments: str, lines: int, fps: int = 8, faultless: bool = True) -> Iterator[Server]:
    """Context with `vsmrc serve` at a free port, once it has printed `lines` lines. Without a token, unless the
    arguments name one, even on a machine with other users. Raises AssertionError with what it complained of where it
    ended before, and at the end where it logged a fault.
    faultless: False where faults are provoked, or judged elsewhere."""
    asks = any(name in arguments for name in ("--token", "--token-file", "--origin", "--host"))
    command = [sys.executable, "-m", "app", "serve", "--port", "0", "--fps", str(fps), *arguments]
    command += [] if asks else ["--token", "never"]
    # what it complains of goes to a file: a pipe that nobody reads would be full one day, and the server stand still
    with (
        tempfile.TemporaryFile("w+") as complaints,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=complaints, text=True) as process,
    ):
        try:
            assert process.stdout is not None
            printed: list[str] = []
            for line in process.stdout:
                if printed or line.startswith("VSMRC Lab: "):
                    printed.append(line)
                if len(printed) == lines:
                    break
            assert len(printed) == lines, f"the server ended: {_text(complaints)}"
            yield Server(process, printed)
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
                process.communicate(timeout=30)
        if faultless:
            assert not _FAULT.search(text := _text(complaints)), text


def _text(file: IO[str]) -> str:
    """Everything that was written to a file."""
    file.seek(0)
    return file.read()


def gone(pid: int, seconds: float = PATIENCE) -> bool:
    """Whether a process has ended, or ends within `seconds`."""
    try:
        file = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([file], [], [], seconds)[0])
    finally:
        os.close(file)
