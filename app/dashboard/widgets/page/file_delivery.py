"""Delivery of files to the page that asked for them, with a note of the progress or of the failure."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable

import structlog
import viser

from app.export.export_jobs import ExportError
from app.storage.recording_files import ProgressCallback

log = structlog.get_logger()


class FileDelivery:
    """Delivery of files that are made in another process, so that the run goes on, or drawn by a page."""

    def __init__(self) -> None:
        self._lock, self._busy = threading.Lock(), set[Hashable]()

    def give(
        self,
        event: viser.GuiEvent,
        what: str,
        name: str,
        make: Callable[[ProgressCallback], bytes],
        maker: Hashable = None,
    ) -> None:
        """Make a file and send it to the page that asked. To be called in a thread that may wait.
        what: name of the file in sentences.
        name: file name.
        make: returns the content.
        maker: makes one file at a time; by default the process for exports, else the page that draws a picture."""
        client = event.client
        if client is None:
            return
        with self._lock:
            waits = maker in self._busy
            self._busy.add(maker)
        if waits:
            note = "Another file is being made: try again when it is done."
            client.add_notification(what, note, auto_close_seconds=4.0)
            return
        try:
            content = _made(client, what, name, make)
        finally:
            with self._lock:  # before the file is sent, since its receiver may ask for the next one at once
                self._busy.discard(maker)
        if content is not None:
            client.send_file_download(name, content, save_immediately=True)


def _made(client: viser.ClientHandle, what: str, name: str, make: Callable[[ProgressCallback], bytes]) -> bytes | None:
    """Content of the file; None where it could not be made, after a note to the page."""
    note = client.add_notification(what, f"{name} is being made …", loading=True, with_close_button=False)

    def on_progress(fraction: float) -> None:
        note.body = f"{name} is being made … {fraction:.0%}"

    try:
        content = make(on_progress)
    except Exception as error:
        expected = isinstance(error, ExportError | OSError | RuntimeError | ValueError)
        reason = str(error) or type(error).__name__
        if isinstance(error, OSError) and error.strerror:
            reason = f"the file cannot be written: {error.strerror}"
        log.warning("export failed", file=name, reason=reason, exc_info=None if expected else error)
        note.title, note.body, note.color = f"{what}: failed", reason, "red"
        note.loading, note.with_close_button = False, True
        return None
    note.remove()  # the page itself shows the download
    return content
