"""`vsmrc serve` for other users than the one who started it: runs a server with these settings until Ctrl-C."""

from __future__ import annotations

import asyncio
import contextlib
import math
import signal
import socket
import sys
from pathlib import Path

import structlog

from app.access.admission import Names, OriginError, Tokens, is_loopback
from app.gateway.access_control import AccessSettings
from app.gateway.connections import ARRIVING
from app.gateway.server import Gateway, serving
from app.gateway.server_settings import PageStyle, ServerSettings
from app.gateway.session_pool import SessionPool
from app.gateway.session_store import SessionStore
from app.gateway.visitors import VisitorLimits
from app.gateway.worker import Worker, started
from app.process import open_files, precompile
from app.process.cores import usable_cores
from app.process.deadline import end_within
from app.process.fork_server import ForkServer
from app.process.terminal_text import print_line
from app.scenario.data import to_toml
from app.scenario.errors import ScenarioError
from app.scenario.number_text import counted
from app.scenario.schema import Scenario
from app.storage.session_index import StateError

log = structlog.get_logger()

SESSIONS_PER_CORE = 2.0  # at 1 kHz, each looked at by one page: docs/performance.md


def serve(scenario: Scenario, style: PageStyle, server_settings: ServerSettings, state_dir: Path | None) -> None:
    """Serve until Ctrl-C or SIGTERM. state_dir: folder in which sessions are kept for the next start, None to keep
    none.

    Raises ScenarioError for settings that make no sense, and PortTaken.
    """
    names, tokens = _names(server_settings), _tokens(server_settings)
    if server_settings.capacity is not None and server_settings.capacity < 1:
        raise ScenarioError(f"--max-sessions: {server_settings.capacity}; allowed: 1 or more")
    if server_settings.of_one_address is not None and server_settings.of_one_address < 1:
        raise ScenarioError(f"--per-address: {server_settings.of_one_address}; allowed: 1 or more")
    if not 0 < server_settings.idle_minutes < math.inf:
        raise ScenarioError(f"--idle-minutes: {server_settings.idle_minutes:g}; allowed: more than 0")
    sessions = (server_settings.capacity or default_capacity()) if server_settings.shared else 1
    open_files.require(_files(sessions), f"for {counted(sessions, 'session')} and their pages")
    try:
        # in separate folders, apart from that of a server for its own user
        store = SessionStore(state_dir / ("shared" if server_settings.shared else "everyone")) if state_dir else None
        with contextlib.closing(store) if store else contextlib.nullcontext():
            asyncio.run(_serve(to_toml(scenario), style, server_settings, names, tokens, store))
    except StateError as error:
        raise ScenarioError(str(error)) from error


def default_capacity() -> int:
    """Number of sessions that this machine can run at once."""
    return max(1, math.floor(usable_cores() * SESSIONS_PER_CORE))


def _files(sessions: int) -> int:
    """Number of files that may be open at once: each page has two connections, its own and the one to its session."""
    return 64 + 2 * VisitorLimits().pages.total + ARRIVING + 4 * (sessions + 1)


def _names(server_settings: ServerSettings) -> Names:
    try:
        return Names(server_settings.host, server_settings.origins)
    except OriginError as error:
        raise ScenarioError(f"--{error}") from error


def _tokens(server_settings: ServerSettings) -> Tokens | None:
    """Tokens of the server, None for none. Raises ScenarioError where none is wanted and one is needed or given."""
    if server_settings.token == "never":
        if not is_loopback(server_settings.host):
            raise ScenarioError(f"--token: never, with --host {server_settings.host}; allowed: only with 127.0.0.1")
        if server_settings.given is not None:
            raise ScenarioError("--token: never, with a token given; allowed: auto, always")
    return server_settings.new_tokens()


async def _serve(
    scenario: str,
    style: PageStyle,
    server_settings: ServerSettings,
    names: Names,
    tokens: Tokens | None,
    store: SessionStore | None,
) -> None:
    shared = server_settings.shared
    # one session alone would have nothing to share with others
    forks = ForkServer(scenario) if shared and sys.platform == "linux" else None
    start = started if forks is None else forks.start
    pool = SessionPool(
        scenario,
        lambda toml: Worker.prepared(toml, style, shared=shared, start=start),
        (server_settings.capacity or default_capacity()) if shared else 1,
        60.0 * server_settings.idle_minutes if shared else None,
        store=store,
        spare=shared,
        of_one_address=server_settings.of_one_address,
        classes=server_settings.classes,
    )
    everyone = None if shared else pool.everyone()
    stop = asyncio.Event()
    endings = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # nohup
        endings.append(signal.SIGHUP)
    for number in endings:
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    gateway = Gateway(pool, AccessSettings(names, tokens, everyone, copies=server_settings.copies))
    warming = None
    try:
        async with serving(gateway, server_settings.host, server_settings.port) as port:
            warming = precompile.start()
            address = _address(server_settings, port)
            # a given token is known already to those who are to have it, and need not be in the journal
            shown = tokens if server_settings.given is None else Tokens("TOKEN", "WATCH-TOKEN")
            print_line(f"VSMRC Lab: {_link(address, shown, '')}  (Ctrl-C ends it)")
            if everyone is not None:
                watch = f"watch/{everyone.watch}/"
                print_line(f"to watch:  {address}/{watch}" + (f"?token={shown.watch}" if shown else ""))
            else:
                listening = f", listening at {server_settings.host}:{port}" if server_settings.origins else ""
                print_line(f"{pool.capacity} sessions at once (--max-sessions){listening}")
            log.info("listening", url=address)
            await stop.wait()
            end_within()
            print_line("\nended")
    finally:
        if forks is not None:
            forks.close()
        if warming is not None:
            warming.terminate()


def _link(address: str, tokens: Tokens | None, path: str) -> str:
    return f"{address}/{path}" + (f"?token={tokens.steer}" if tokens else "")


def _address(server_settings: ServerSettings, port: int) -> str:
    """Address at which others reach the server."""
    if server_settings.origins:
        return server_settings.origins[0].rstrip("/")
    host = server_settings.host
    if host in ("0.0.0.0", "::"):
        host = _outward() or socket.gethostname()
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def _outward() -> str | None:
    """This machine's address in the network; nothing is sent to find it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
        except OSError:
            return None
        return probe.getsockname()[0]
