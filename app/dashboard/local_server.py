"""`vsmrc serve` for the user who started it: one run, one page, in this process, until Ctrl-C."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
import time
from concurrent.futures import Future
from pathlib import Path
from subprocess import Popen

import structlog
from tqdm import tqdm

from app.dashboard.page import Dashboard
from app.dashboard.widgets.page.last_session import left_by
from app.process import precompile
from app.process.deadline import FAILED, end_within
from app.process.interruption import Interruption
from app.process.priority import RealTimePriority
from app.process.terminal_text import print_line
from app.scenario.errors import ScenarioError, scenario_errors
from app.scenario.own_code import own_code
from app.scenario.schema import Scenario
from app.session.autosave import Autosave, StateFolder, default_folder
from app.session.runner import Runner
from app.simulation.warm_up import warm_up_for_own_laws
from app.storage.session_index import StateError

events = structlog.get_logger()


def serve(
    scenario: Scenario, dashboard: Dashboard, interruption: Interruption, *, state_dir: Path | None, stateless: bool
) -> None:
    """Run a scenario on a page until the user ends it. Raises ScenarioError for a folder that cannot be used.

    dashboard: closed at the end.
    interruption: handles the signals that end the server.
    state_dir: folder that keeps the session, None for the usual one.
    stateless: keep nothing.
    """
    runner: Runner | None = None
    warming: Popen[bytes] | None = None
    autosave: Autosave | None = None
    try:
        with contextlib.suppress(KeyboardInterrupt):
            print_line(f"VSMRC Lab: {dashboard.link}  (Ctrl-C ends it)")
            events.info("listening", url=dashboard.url)
            folder = None if stateless else _state_folder(state_dir)
            runner = _prepared(scenario, dashboard)
            runner.start(RealTimePriority())
            events.info("session opened", scenario=scenario.name)
            dashboard.attach(runner)
            if folder is not None:
                with scenario_errors():
                    problem = dashboard.notebook.keep_in(folder.path)
                if problem:
                    print_line(problem)
                autosave = Autosave(folder, lambda: runner.unrefreshed, dashboard.fail)
                if (last_session := left_by(folder, autosave, scenario)) is not None:
                    if last_session.problem:
                        print_line(last_session.problem)
                    dashboard.offer(last_session)
            warming = precompile.start()
            dashboard.run_forever(until=lambda: interruption.requested)
        print_line("\nended")
    finally:
        for ending in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(ending, signal.SIG_IGN)  # an impatient second Ctrl-C must not interrupt the ending
        end_within(0 if sys.exc_info()[0] is None else FAILED)
        if autosave is not None:  # first, since another part that hangs may use up the time
            autosave.close()
        dashboard.close()
        if warming is not None:
            warming.terminate()
        if runner is not None:
            runner.close()
        events.info("session closed")


def _state_folder(chosen: Path | None) -> StateFolder | None:
    """Folder that keeps the session; None where the usual one cannot be used, which must not prevent the start."""
    try:
        return StateFolder(chosen or default_folder())
    except StateError as error:
        if chosen is not None:
            raise ScenarioError(str(error)) from error
        print_line(f"this session is not kept: {error}")
    except OSError as error:
        print_line(f"this session is not kept: {error.strerror}")
    return None


def _prepared(scenario: Scenario, dashboard: Dashboard) -> Runner:
    """Runner with compiled kernels; terminal and page show the progress of the preparation."""
    ready: Future[Runner] = Future()

    def prepare() -> None:
        try:
            runner = Runner(scenario)
            if own_code().laws:
                warm_up_for_own_laws(runner.snapshot.system)
            ready.set_result(runner)
        except BaseException as error:
            ready.set_exception(error)

    # a daemon, and no pool: Ctrl-C must not wait for the compiler
    threading.Thread(target=prepare, name="preparing", daemon=True).start()
    started = time.monotonic()
    with tqdm(bar_format="{desc} {elapsed}", leave=False, disable=None) as bar:
        while not ready.done():
            time.sleep(0.1)
            elapsed = time.monotonic() - started
            doing = "preparing" if elapsed < 3 else "compiling the control law (only the first start takes this long)"
            bar.set_description(doing)
            dashboard.show_progress(f"{doing} … {elapsed:.0f} s")
    return ready.result()
