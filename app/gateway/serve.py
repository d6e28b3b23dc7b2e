"""`vsmrc serve` for others than the one who started it: settings in, a server that runs until Ctrl-C."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import signal
import socket
from pathlib import Path

import structlog

from app.access.admission import Names, OriginError, Tokens
from app.gateway.connections import ARRIVING
from app.gateway.server import Doors, Gateway, serving
from app.gateway.server_settings import Invitation, Look
from app.gateway.session_pool import House
from app.gateway.session_store import Register
from app.gateway.visitors import Shares
from app.gateway.worker import Worker
from app.process import open_files, precompile
from app.process.deadline import end_within
from app.process.terminal_text import say
from app.scenario.data import to_toml
from app.scenario.schema import Scenario, ScenarioError
from app.storage.session_index import StateError

log = structlog.get_logger()

SESSIONS_PER_CORE = 2.0  # at 1 kHz, each looked at by one page: docs/performance.md


def serve(scenario: Scenario, look: Look, invitation: Invitation, state_dir: Path | None) -> None:
    """Serve until Ctrl-C or SIGTERM. state_dir: where sessions are kept for the next start, None for nowhere.

    Raises ScenarioError for settings that make no sense, and PortTaken.
    """
    names, tokens = _names(invitation), _tokens(invitation)
    if invitation.places is not None and invitation.places < 1:
        raise ScenarioError(f"--max-sessions: {invitation.places}; allowed: 1 or more")
    if invitation.of_one_address is not None and invitation.of_one_address < 1:
        raise ScenarioError(f"--per-address: {invitation.of_one_address}; allowed: 1 or more")
    if not 0 < invitation.idle_minutes < math.inf:
        raise ScenarioError(f"--idle-minutes: {invitation.idle_minutes:g}; allowed: more than 0")
    sessions = (invitation.places or places()) if invitation.shared else 1
    open_files.require(_files(sessions), f"for {sessions} {'session' if sessions == 1 else 'sessions'} and their pages")
    try:
        # apart from each other, and from what a server for its own user keeps there
        register = Register(state_dir / ("shared" if invitation.shared else "everyone")) if state_dir else None
        with contextlib.closing(register) if register else contextlib.nullcontext():
            asyncio.run(_serve(to_toml(scenario), look, invitation, names, tokens, register))
    except StateError as error:
        raise ScenarioError(str(error)) from error


def cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def places() -> int:
    """How many sessions this machine holds."""
    return max(1, math.floor(cores() * SESSIONS_PER_CORE))


def _files(sessions: int) -> int:
    """That may be open at once: each page has two, its own and the one to its session."""
    return 64 + 2 * Shares().pages.total + ARRIVING + 4 * (sessions + 1)


def _names(invitation: Invitation) -> Names:
    try:
        return Names(invitation.host, invitation.origins)
    except OriginError as error:
        raise ScenarioError(f"--{error}") from error


def _tokens(invitation: Invitation) -> Tokens | None:
    """Raises ScenarioError where none is wanted and one is needed or given."""
    if invitation.token == "never":
        if not Names(invitation.host).local:
            raise ScenarioError(f"--token: never, with --host {invitation.host}; allowed: only with 127.0.0.1")
        if invitation.given is not None:
            raise ScenarioError("--token: never, with a token given; allowed: auto, always")
    return invitation.tokens


async def _serve(
    scenario: str,
    look: Look,
    invitation: Invitation,
    names: Names,
    tokens: Tokens | None,
    register: Register | None,
) -> None:
    shared = invitation.shared
    house = House(
        scenario,
        lambda toml: Worker.prepared(toml, look),
        (invitation.places or places()) if shared else 1,
        60.0 * invitation.idle_minutes if shared else None,
        register=register,
        spare=shared,
        of_one_address=invitation.of_one_address,
    )
    everyone = None if shared else house.everyone()
    stop = asyncio.Event()
    endings = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # nohup
        endings.append(signal.SIGHUP)
    for number in endings:
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    gateway = Gateway(house, Doors(names, tokens, everyone, copies=invitation.copies))
    warming = None
    try:
        async with serving(gateway, invitation.host, invitation.port) as port:
            warming = precompile.start()
            address = _address(invitation, port)
            # a token that was given is known to who is to have it, and need not be in the journal
            shown = tokens if invitation.given is None else Tokens("TOKEN", "WATCH-TOKEN")
            say(f"VSMRC Lab: {_link(address, shown, '')}  (Ctrl-C ends it)")
            if everyone is not None:
                watch = f"watch/{everyone.watch}/"
                say(f"to watch:  {address}/{watch}" + (f"?token={shown.watch}" if shown else ""))
            else:
                listening = f", listening at {invitation.host}:{port}" if invitation.origins else ""
                say(f"{house.places} sessions at once (--max-sessions){listening}")
            log.info("listening", url=address)
            await stop.wait()
            end_within()
            say("\nended")
    finally:
        if warming is not None:
            warming.terminate()


def _link(address: str, tokens: Tokens | None, path: str) -> str:
    return f"{address}/{path}" + (f"?token={tokens.steer}" if tokens else "")


def _address(invitation: Invitation, port: int) -> str:
    """By which others reach the server."""
    if invitation.origins:
        return invitation.origins[0].rstrip("/")
    host = invitation.host
    if host in ("0.0.0.0", "::"):
        host = _outward() or socket.gethostname()
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def _outward() -> str | None:
    """This machine's address towards others; nothing is sent to find it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
        except OSError:
            return None
        return probe.getsockname()[0]
