"""Command `vsmrc serve`: opens the dashboard."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Annotated, get_args

import tyro

from app.access.admission import is_loopback
from app.access.given_token import given_token
from app.access.rate_limits import ConnectionLimits
from app.cli.options import (
    NO_DEFAULT_SHOWN,
    Default,
    Files,
    Settings,
    braces,
    configured,
    one_of,
    require_folder,
    typed,
    use_own,
)
from app.cli.status import DONE
from app.dashboard.theme.colors import Theme
from app.gateway.server_settings import PageStyle, ServerSettings, Token
from app.process import log, open_files
from app.process.interruption import Interruption
from app.process.other_users import other_people
from app.process.terminal_text import print_line
from app.scenario.data import OPENING
from app.scenario.errors import ScenarioError

THEMES: tuple[Theme, ...] = get_args(Theme)

TOKENS: tuple[Token, ...] = get_args(Token)

LEVELS: tuple[log.Level, ...] = get_args(log.Level)

IDLE_MINUTES, COPIES = Default(ServerSettings.idle_minutes), Default(True)

FILES = (
    64 + 2 * ConnectionLimits().per_session
)  # open at once in a server for oneself: its own, pages and new connections


def serve(
    scenario: Annotated[str, tyro.conf.Positional] = OPENING,
    /,
    *,
    host: Annotated[str, tyro.conf.arg(metavar="ADDRESS")] = "127.0.0.1",
    port: int = 8080,
    theme: Annotated[str, tyro.conf.arg(metavar=braces(THEMES))] = "dark",
    fps: float = 30.0,
    state_dir: Annotated[Path | None, NO_DEFAULT_SHOWN] = None,
    stateless: bool = False,
    log_level: Annotated[str | None, tyro.conf.arg(metavar=braces(LEVELS)), NO_DEFAULT_SHOWN] = None,
    log_file: Annotated[Path | None, NO_DEFAULT_SHOWN] = None,
    shared: bool = False,
    token: Annotated[str, tyro.conf.arg(metavar=braces(TOKENS))] = "auto",
    token_file: Annotated[Path | None, NO_DEFAULT_SHOWN] = None,
    origin: Annotated[tuple[str, ...], NO_DEFAULT_SHOWN] = (),
    max_sessions: Annotated[int | None, NO_DEFAULT_SHOWN] = None,
    per_address: Annotated[int | None, NO_DEFAULT_SHOWN] = None,
    copies: Annotated[tyro.conf.DisallowNone[bool | None], COPIES.hint] = None,
    classes: Annotated[bool, tyro.conf.arg(name="class")] = False,
    idle_minutes: Annotated[float | None, IDLE_MINUTES.hint] = None,
    use: Files = (),
    settings: Settings = (),
) -> int:
    """Start the dashboard server, for yourself or for an audience.

    Args:
        scenario: the first scenario: the name of a shipped one, or a .toml file
        host: address to listen on. With 127.0.0.1, only programs on this machine can connect. With any other address,
            visitors need the link with the token.
        port: port to listen on
        theme: theme of the page at the start; the key T switches it on the page
        fps: frames per second of the 3-D scene, 1 to 60; fewer frames leave more computing time to the control loop
        state_dir: folder in which the server saves scenarios and pinned runs for its next start; by default
            ~/.local/state/vsmrc-lab. A server for an audience (--shared, --class, --host, --origin, a given token, or
            --token always) saves nothing unless you name a folder.
        stateless: save nothing
        log_level: lowest level that is logged; by default warning on the terminal and info in the log file
        log_file: also write the log to this file
        shared: give every visitor a separate session in its own process, with one link to control it and one to watch
        token: whether visitors must show a token. auto: yes, if anyone but your own programs can connect; always: yes;
            never: no, for a proxy that does the sign-in.
        token_file: file that contains the token for control; without it, the token comes from the environment variable
            VSMRC_TOKEN, or the server generates one
        origin: public addresses of the server behind a proxy, such as https://lab.example.org
        max_sessions: with --shared: how many sessions run at once; further visitors wait in a queue. By default two per
            core.
        per_address: with --shared: how many of these sessions one address may have; by default three quarters of them
        copies: with --shared: whether a visitor who watches a session may take a private copy of it
        classes: let a lecturer put the questions of a lesson to a class; students answer on their phones by a link or
            QR code
        idle_minutes: with --shared: close a session after so many minutes without a viewer; its link reopens it
        use: file with your own control law, surface or trajectory (docs/extending.md); it runs with your rights
    """
    chosen_theme: Theme = one_of("--theme", theme, THEMES)
    asking: Token = one_of("--token", token, TOKENS)
    _log(log_level, log_file)
    interruption = _interruption()
    _require_fps(fps)
    _require_address(host, port)
    _require_state_folder(state_dir, stateless=stateless)
    _require_limits(max_sessions, per_address, idle_minutes, copies, shared=shared)
    use_own(use)
    chosen = configured(scenario, settings)
    people = other_people() if asking == "auto" else []
    server_settings = ServerSettings(
        host=host,
        port=port,
        shared=shared,
        token=asking,
        origins=origin,
        capacity=max_sessions,
        of_one_address=per_address,
        copies=COPIES.unless(copies),
        classes=classes,
        idle_minutes=IDLE_MINUTES.unless(idle_minutes),
        given=given_token(token_file, os.environ),
        crowded=bool(people),
    )
    if people and is_loopback(host) and not origin:
        print_line(f"{', '.join(people[:3])} can use this machine, too: the link has a token (--token never: none)")
    if server_settings.open:
        from app.gateway.serve import serve as serve_others

        serve_others(chosen, PageStyle(chosen_theme, fps), server_settings, None if stateless else state_dir)
        return DONE
    from app.dashboard import local_server
    from app.dashboard.page import Dashboard

    open_files.require(FILES, "for the session and its pages")
    dashboard = Dashboard(host=host, port=port, theme=chosen_theme, fps=fps, tokens=server_settings.new_tokens())
    local_server.serve(chosen, dashboard, interruption, state_dir=state_dir, stateless=stateless)
    return DONE


def _require_state_folder(state_dir: Path | None, *, stateless: bool) -> None:
    """Raises ScenarioError for a folder of the state that cannot be used, or that a stateless server would not use."""
    if stateless and state_dir is not None:
        raise ScenarioError(f"--state-dir {state_dir}: --stateless keeps nothing; allowed: one of both")
    if state_dir is not None:
        require_folder(state_dir, "--state-dir")


def _require_limits(
    max_sessions: int | None,
    per_address: int | None,
    idle_minutes: float | None,
    copies: bool | None,
    *,
    shared: bool,
) -> None:
    """Raises ScenarioError for limits on sessions that exclude each other, or of a server with one session."""
    limits = {"--max-sessions": max_sessions, "--per-address": per_address, "--idle-minutes": idle_minutes}
    limits["--copies" if copies else "--no-copies"] = copies
    if not shared and (needless := [flag for flag, given in limits.items() if typed(given)]):
        raise ScenarioError(f"{needless[0]}: this server has one session; allowed: with --shared")
    if max_sessions is not None and per_address is not None and per_address > max_sessions:
        raise ScenarioError(f"--per-address {per_address}; allowed: at most {max_sessions}, as --max-sessions says")


def _require_address(host: str, port: int) -> None:
    """Raises ScenarioError for an address or a port on which nothing can listen."""
    if not 0 <= port <= 65535:
        raise ScenarioError(f"--port {port}; allowed: 0 to 65535")
    if not host.strip():
        raise ScenarioError(f"--host {host!r}: no address; allowed: an address, 0.0.0.0 for all of this machine")


def _require_fps(fps: float) -> None:
    """Raises ScenarioError for a number of pictures per second that is not possible."""
    from app.dashboard.frame_rate import check_fps

    try:
        check_fps(fps)
    except ValueError as error:
        raise ScenarioError(f"--{error}") from error


def _log(log_level: str | None, log_file: Path | None) -> None:
    """Log from this level on, also to this file. Raises ScenarioError."""
    level: log.Level | None = None
    if log_level is not None:
        named: log.Level = one_of("--log-level", log_level, LEVELS)
        level = named
    try:
        log.configure(level, log_file)
    except OSError as error:
        raise ScenarioError(f"--log-file {log_file}: cannot be written: {error.strerror}") from error


def _interruption() -> Interruption:
    """Handler of the signals that end the server, from now on."""
    interruption = Interruption()
    signal.signal(signal.SIGINT, interruption)  # a script with & starts programs with it ignored
    for ending in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(ending) is not signal.SIG_IGN:  # nohup
            signal.signal(ending, interruption)
    return interruption
