"""Command `vsmrc serve`: opens the dashboard."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Annotated, get_args

import tyro

from app.access.admission import Names
from app.access.given_token import given_token
from app.access.rate_limits import ConnectionLimits
from app.cli.options import Default, Files, Settings, braces, configured, one_of, typed, use_own
from app.cli.status import DONE
from app.dashboard.theme.colors import Theme
from app.gateway.server_settings import PageStyle, ServerSettings, Token
from app.process import log, open_files
from app.process.interruption import Interruption
from app.process.other_users import other_people
from app.process.terminal_text import say
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
    state_dir: Path | None = None,
    stateless: bool = False,
    log_level: Annotated[str | None, tyro.conf.arg(metavar=braces(LEVELS))] = None,
    log_file: Path | None = None,
    shared: bool = False,
    token: Annotated[str, tyro.conf.arg(metavar=braces(TOKENS))] = "auto",
    token_file: Path | None = None,
    origin: tuple[str, ...] = (),
    max_sessions: int | None = None,
    per_address: int | None = None,
    copies: Annotated[tyro.conf.DisallowNone[bool | None], COPIES.hint] = None,
    classes: Annotated[bool, tyro.conf.arg(name="class")] = False,
    idle_minutes: Annotated[float | None, IDLE_MINUTES.hint] = None,
    use: Files = (),
    settings: Settings = (),
) -> int:
    """Open the dashboard, for yourself or for an audience.

    Args:
        scenario: a shipped scenario or a .toml file to begin with
        host: address to listen at; only this machine can reach 127.0.0.1, another one needs the link with the token
        port: port to listen at
        theme: how the page looks at first; T changes it there
        fps: pictures of the scene per second; without a graphics card, few leave more to the loop
        state_dir: folder that keeps scenarios and pinned runs for the next start, instead of ~/.local/state/vsmrc-lab,
            and for an audience (--shared, --class, --host, --origin, a given token, or --token always), whose sessions
            else end with the server
        stateless: keep nothing
        log_level: what is logged; by default warnings, and what is of interest afterwards to the file, too
        log_file: a file to log to as well
        shared: a session for every visitor, each in a process of its own, with links to watch and to steer it
        token: ask for a token: unless only your own programs can come (auto), always, or never, as a proxy asks
        token_file: where the token to steer is, which else is VSMRC_TOKEN of the environment or made at the start
        origin: public addresses behind a proxy, such as https://lab.example.org
        max_sessions: with --shared, how many run at once, instead of what this machine holds; the others queue
        per_address: with --shared, how many of them one address may have, instead of all but a quarter
        copies: with --shared, whether who watches may take a private copy of the session
        classes: let the lessons of a session ask a class, which answers on its phones by a link or QR code
        idle_minutes: with --shared, a session that nobody looks at so long is closed; its link brings it back
        use: a file with a law, surface or trajectory of your own (docs/extending.md); it runs as your program
    """
    chosen_theme: Theme = one_of("--theme", theme, THEMES)
    asking: Token = one_of("--token", token, TOKENS)
    _log(log_level, log_file)
    interruption = _interruption()
    _require_fps(fps)
    if not 0 <= port <= 65535:
        raise ScenarioError(f"--port {port}; allowed: 0 to 65535")
    if not host.strip():
        raise ScenarioError(f"--host {host!r}: no address; allowed: an address, 0.0.0.0 for all of this machine")
    if stateless and state_dir is not None:
        raise ScenarioError(f"--state-dir {state_dir}: --stateless keeps nothing; allowed: one of both")
    limits = {"--max-sessions": max_sessions, "--per-address": per_address, "--idle-minutes": idle_minutes}
    limits["--copies" if copies else "--no-copies"] = copies
    if not shared and (needless := [flag for flag, given in limits.items() if typed(given)]):
        raise ScenarioError(f"{needless[0]}: this server has one session; allowed: with --shared")
    use_own(use)
    chosen = configured(scenario, settings)
    people = other_people() if asking == "auto" else []
    server_settings = ServerSettings(
        host=host,
        port=port,
        shared=shared,
        token=asking,
        origins=origin,
        places=max_sessions,
        of_one_address=per_address,
        copies=COPIES.unless(copies),
        classes=classes,
        idle_minutes=IDLE_MINUTES.unless(idle_minutes),
        given=given_token(token_file, os.environ),
        crowded=bool(people),
    )
    if people and Names(host).local and not origin:
        say(f"{', '.join(people[:3])} can use this machine, too: the link has a token (--token never: none)")
    if server_settings.open:
        from app.gateway.serve import serve as serve_others

        serve_others(chosen, PageStyle(chosen_theme, fps), server_settings, None if stateless else state_dir)
        return DONE
    from app.dashboard import local_server
    from app.dashboard.page import Dashboard

    open_files.require(FILES, "for the session and its pages")
    dashboard = Dashboard(host=host, port=port, theme=chosen_theme, fps=fps, tokens=server_settings.tokens)
    local_server.serve(chosen, dashboard, interruption, state_dir=state_dir, stateless=stateless)
    return DONE


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
