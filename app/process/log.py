"""The log: one line of key=value per event that matters, on the terminal and, if asked for, in a file.

`configure` is called once, at the entry of a process. The rest of the program takes `structlog.get_logger()` and names
an event and its fields. Events that libraries log go to the file, too, not to the terminal.
"""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import threading
import traceback
from collections.abc import Callable, MutableMapping
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import structlog

from app.process.log_file import GrowingLog, LogFile
from app.process.redaction import redacted

Level = Literal["debug", "info", "warning", "error"]
Event = MutableMapping[str, Any]

TERMINAL, FILE = "warning", "info"  # levels, unless the user says otherwise
MOST = 20  # lines of one event, or of one library, in one second
LONGEST, LONGEST_TRACEBACK = 1000, 8000  # characters of a value; with a few fields, a line stays below 50 kB
OURS = ("app", "__main__")

_LEVEL, _FILE = "VSMRC_LOG_LEVEL", "VSMRC_LOG_FILE"  # environment of the processes that this one starts
# characters that would move the cursor, ring, or turn the direction of writing; the renderer handles line ends
_CONTROLS = {
    code: f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"
    for code in (*range(0x0A), *range(0x0B, 0x20), *range(0x7F, 0xA0), 0x2028, 0x2029, 0x200E, 0x200F,
                 *range(0x202A, 0x202F), *range(0x2066, 0x206A), *range(0xD800, 0xE000))
}  # fmt: skip


def configure(level: Level | None = None, file: Path | None = None) -> None:
    """Log to the terminal, and to `file` as well, events of `level` and above; by default warnings to the terminal, and
    to the file also the events that are of interest afterwards.

    Processes started from now on log to the same places. Tracebacks go to the file only: those of our own faults
    always, those that libraries caught with level "debug". Raises OSError when the file cannot be opened; a disk that
    is full later is reported once, and logging goes on.
    """
    structlog.configure(
        processors=[structlog.stdlib.filter_by_level, structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
    )
    terminal = _Lines(_to_terminal, level or TERMINAL, _formatter(_without_traceback))
    terminal.addFilter(_is_ours)
    handlers = [terminal]
    if file is not None:
        opened, keep = LogFile(file), level == "debug"
        handlers.append(_Lines(opened.write, level or FILE, _formatter(_with_traceback(keep)), opened.close))
    root = logging.getLogger()
    for old in root.handlers[:]:
        if isinstance(old, _Lines):
            root.removeHandler(old)
            old.close()
    for handler in handlers:
        root.addHandler(handler)
    root.setLevel(min(handler.level for handler in handlers))
    for chatty in ("websockets", "asyncio", "matplotlib", "PIL", "numba", "trimesh"):
        logging.getLogger(chatty).setLevel(max(root.level, logging.INFO))
    logging.captureWarnings(True)
    threading.excepthook = _thread_failed
    os.environ |= {_LEVEL: level or "", _FILE: "" if file is None else str(file.absolute())}


def configure_as_parent() -> None:
    """Log as the process that started this one does, without a file where it cannot be opened any more."""
    named = os.environ.get(_LEVEL, "")
    level: Level | None = named if named in ("debug", "info", "warning", "error") else None  # pyright: ignore[reportAssignmentType]
    file = os.environ.get(_FILE, "")
    try:
        configure(level, Path(file) if file else None)
    except OSError:
        configure(level)


class _Lines(logging.Handler):
    """Handler that writes lines, at most `MOST` a second of one event or of one library; after a flood, it writes how
    many were left out.
    `write` raises OSError where it cannot write, which is reported once; `end` is called at the end."""

    def __init__(
        self,
        write: Callable[[str], None],
        level: str,
        formatter: logging.Formatter,
        end: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(level.upper())
        self.setFormatter(formatter)
        self._write, self._end = write, end
        self._seen: dict[object, tuple[int, int]] = {}  # by event: the second, and how many there were in it
        self._complained = False

    def emit(self, record: logging.LogRecord) -> None:
        left_out = self._left_out(record)
        if left_out is None:
            return
        try:
            line = self.format(record) + (f" left_out={left_out}" if left_out else "")
            self._write(line + "\n")
        except GrowingLog as error:
            _print_error(f"the log: {error.strerror}")
        except OSError as error:
            if not self._complained:
                self._complained = True
                _print_error(f"the log cannot be written: {error.strerror or error}; going on")
        except Exception:  # a value that cannot be converted to text must not stop the code that logs it
            self.handleError(record)

    def handleError(self, record: logging.LogRecord) -> None:
        error = sys.exc_info()[1]
        _print_error(f"an event of {record.name} cannot be logged: {type(error).__name__}")

    def _left_out(self, record: logging.LogRecord) -> int | None:
        """Number of these events that were left out before this one; None when this one is to be left out, too."""
        # libraries may put anything into a message
        event = record.msg["event"] if isinstance(record.msg, dict) else ""
        key, second = (record.name, event), int(record.created)
        began, count = self._seen.get(key, (second, 0))
        if began != second:
            began, left_out, count = second, max(count - MOST, 0), 0
        else:
            left_out = 0
        if len(self._seen) > 1000:
            self._seen.clear()
        self._seen[key] = (began, count + 1)
        return left_out if count < MOST else None

    def close(self) -> None:
        self._end()
        super().close()


def _print_error(sentence: str) -> None:
    with contextlib.suppress(OSError, ValueError):  # a terminal that has been closed
        print(f"vsmrc: {sentence}", file=sys.stderr)


def _to_terminal(line: str) -> None:
    sys.stderr.write(line)
    sys.stderr.flush()


def _is_ours(record: logging.LogRecord) -> bool:
    return record.name.partition(".")[0] in OURS


def _formatter(exceptions: structlog.types.Processor) -> logging.Formatter:
    return structlog.stdlib.ProcessorFormatter(
        processors=[
            _described,
            exceptions,
            structlog.stdlib.ProcessorFormatter.remove_processors_meta,
            _escaped,
            structlog.processors.LogfmtRenderer(),
        ],
    )


def _described(_: object, __: str, event: Event) -> Event:
    """The event with time, level and name first, then the fields, then logger and process."""
    record = event["_record"]
    stamp = structlog.processors.TimeStamper(fmt="iso", utc=True)(None, "", {})["timestamp"]
    first = {"time": stamp, "level": record.levelname.lower(), "event": event.pop("event")}
    return first | dict(event) | {"by": record.name, "process": record.process}


def _without_traceback(_: object, __: str, event: Event) -> Event:
    """The event with the class of an exception and its message."""
    if error := _exception(event.pop("exc_info", None)):
        event["error"] = f"{type(error).__name__}: {error}"
    return event


def _with_traceback(libraries: bool) -> structlog.types.Processor:
    """Processor that also adds the traceback; that of an exception in a library only if `libraries`."""

    def processor(logger: Any, name: str, event: Event) -> Event:
        error = _exception(event.get("exc_info"))
        event = _without_traceback(logger, name, event)
        if error is not None and (libraries or event.get("_from_structlog")):
            event["traceback"] = "".join(traceback.format_exception(error)).rstrip()
        return event

    return processor


def _exception(exc_info: object) -> BaseException | None:
    """Exception of the `exc_info` that a caller gives: True for the one being handled, the exception itself, or a
    tuple."""
    if exc_info is True:
        return sys.exc_info()[1]
    if isinstance(exc_info, tuple):
        return exc_info[1]
    return exc_info if isinstance(exc_info, BaseException) else None


def _escaped(_: object, __: str, event: Event) -> Event:
    """The event with safe values: none can begin a line or reach the terminal as a command, none is long, and none is
    secret. Its keys are words of this program."""
    return {key: _plain(value, LONGEST_TRACEBACK if key == "traceback" else LONGEST) for key, value in event.items()}


def _plain(value: object, longest: int) -> object:
    if isinstance(value, bool | float | None) or (isinstance(value, int) and abs(value) < 2**64):
        return value
    # cut twice: a part of a secret that the first cut leaves is at the middle, which the second one removes
    text = redacted(_cut(str(value), 2 * longest))
    return _cut(text, longest).translate(_CONTROLS)


def _cut(text: str, longest: int) -> str:
    """Beginning and end of a text that is longer."""
    half = longest // 2
    return text if len(text) <= longest else f"{text[:half]} … {text[-half:]}"


def _thread_failed(failure: threading.ExceptHookArgs) -> None:
    """Log an exception that ended a thread, in one line, as every event."""
    name = failure.thread.name if failure.thread is not None else "unknown"
    caught: tuple[type[BaseException], BaseException | None, TracebackType | None] = (
        failure.exc_type, failure.exc_value, failure.exc_traceback,
    )  # fmt: skip
    structlog.get_logger().error("thread failed", thread=name, exc_info=caught)
