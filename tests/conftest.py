"""What holds for all tests; what those of a browser need is in their own folder, so that no other imports it."""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import pytest
import structlog
from structlog.typing import EventDict, Processor, WrappedLogger

import app  # noqa: F401  # says where kernels are cached, which must come before numba
from app.process import log, priority

if TYPE_CHECKING:
    from app.simulation.omega.extremes import Effort, Objectives, Omega

# All cores are busy with tests meanwhile: what steps back for a loop would wait for minutes.
os.environ[priority.SAME] = "1"

# A collection looks at all that the program has loaded, again and again, and finds little.
gc.set_threshold(20_000, 20, 20)

# A script starts what stands before & with interruptions ignored, and so all that this starts: no test could send one.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

DEFAULTS = structlog.get_config()
PLAINLY = structlog.dev.ConsoleRenderer(colors=False, exception_formatter=structlog.dev.plain_traceback)


class Printer:
    """Logger that prints to the present standard output, of which it holds a reference while it writes. `print`, which
    structlog's own calls, holds none: where a test ends meanwhile, whose output was captured, CPython 3.11 writes into
    freed memory (https://github.com/python/cpython/issues/130163)."""

    def msg(self, message: str) -> None:
        """Print a line, unless the test that captured the output has ended."""
        out = sys.stdout
        with contextlib.suppress(ValueError, OSError):  # closed, or a test has made the disk full
            out.write(f"{message}\n")
            out.flush()

    debug = info = warning = error = critical = exception = msg


def configure_plainly() -> None:
    """Make the log what it is in a process that no command has configured, but for `Printer`. In one call: another
    thread may log between two."""
    structlog.configure(**DEFAULTS | {"processors": [PLAINLY], "logger_factory": lambda *_: Printer()})


@pytest.fixture(scope="session")
def logged_faults() -> Iterator[list[str]]:
    """Faults that the program has caught and logged in this process, with their tracebacks, oldest first; whoever
    configures the log, as each command does that runs within this process, cannot hide them."""
    faults: list[str] = []

    def note(logger: WrappedLogger, level: str, event: EventDict) -> EventDict:
        if event["event"] in ("fault", "thread failed"):
            faults.append(PLAINLY(logger, level, {**event}))
        return event

    def configure(processors: list[Processor], **others: Any) -> None:
        really(processors=[note, *processors], **others)

    with pytest.MonkeyPatch.context() as patch:
        really = structlog.configure
        patch.setattr(structlog, "configure", configure)
        configure_plainly()
        yield faults


@pytest.fixture(autouse=True)
def no_fault(request: pytest.FixtureRequest, logged_faults: list[str]) -> Iterator[None]:
    """A fault that was only logged, as one in drawing a page is, fails the test in which it occurred, unless it has the
    mark "faults"."""
    logged_faults.clear()
    yield
    if request.node.get_closest_marker("faults") is None:
        assert not logged_faults, "\n".join(["a fault was caught and logged:", *logged_faults])


@pytest.fixture(scope="session")
def log_of_tests(logged_faults: list[str]) -> Callable[[], None]:
    """Function that makes the log what it is in a process that no command has configured."""
    del logged_faults  # but they come first
    root, hook, named = logging.getLogger(), threading.excepthook, (log._LEVEL, log._FILE)  # pyright: ignore[reportPrivateUsage]
    level, environment = root.level, {name: os.environ[name] for name in named if name in os.environ}

    def restore() -> None:
        configure_plainly()
        for handler in root.handlers[:]:
            if isinstance(handler, log._Lines):  # pyright: ignore[reportPrivateUsage]
                root.removeHandler(handler)
                handler.close()
        root.setLevel(level)
        logging.captureWarnings(False)
        threading.excepthook = hook
        for name in named:
            os.environ.pop(name, None)
        os.environ.update(environment)

    return restore


@pytest.fixture(autouse=True)
def own_log(log_of_tests: Callable[[], None]) -> Iterator[None]:
    """How a command in one test has configured the log is over in the next."""
    yield
    log_of_tests()


@pytest.fixture(scope="session")
def known_constants(tmp_path_factory: pytest.TempPathFactory) -> object:
    """What the processes of this test run have searched for over Omega, in a folder of the run."""
    from app.simulation.omega.search_memory import Memory
    from app.storage.constants_store import ConstantsStore

    own = tmp_path_factory.getbasetemp()
    run = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own
    return Memory(ConstantsStore(run / "constants", kept=100_000))


@pytest.fixture(autouse=True)
def no_own_laws() -> Iterator[None]:
    """Laws of one's own that a test has used are unknown to the next one."""
    yield
    own_code = sys.modules.get("app.scenario.own_code")
    if own_code is not None and os.environ.pop(own_code.VARIABLE, None) is not None:
        own_code.own_code.cache_clear()


@pytest.fixture(autouse=True, scope="module")
def constants_searched_once(request: pytest.FixtureRequest) -> Iterator[None]:
    """Constants over Omega are searched for once, not by every test that assembles the same arm: each of them has the
    memory that the program has, which knows an answer by all that it depends on.

    Tests of the search itself have a fixture of this name that does nothing.
    """
    with pytest.MonkeyPatch.context() as patch:
        if system := sys.modules.get("app.simulation.assembly"):  # else no test of this file assembles
            known = request.getfixturevalue("known_constants")
            patch.setattr(system, "Memory", lambda: known)
        yield


@pytest.fixture(scope="module")
def roughly_known() -> object:
    """Memory of constants over Omega that are the largest of a few samples."""
    from app.simulation.omega.search_memory import Memory

    return Memory()


@pytest.fixture
def rough_constants(monkeypatch: pytest.MonkeyPatch, roughly_known: object) -> None:
    """Constants over Omega without the search for their maxima, and an eighth of the postures along the reference,
    which together take most of the time of a test that assembles many arms on many surfaces; for tests of what does not
    depend on them. Both have tests of their own."""

    def sampled(omega: Omega, objectives: Objectives, _effort: Effort) -> tuple[float, ...]:
        few = type(places := omega.places(8))(*(each[::3] for each in places))
        return tuple(float(seen.value[seen.room >= 0.0].max(initial=0.0)) for seen in objectives(few))

    monkeypatch.setattr("app.simulation.omega.domain.largest", sampled)
    monkeypatch.setattr("app.simulation.omega.reference_postures.FEWEST", 24)
    monkeypatch.setattr("app.simulation.assembly.Memory", lambda: roughly_known)
