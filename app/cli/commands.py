"""Table of the commands of `vsmrc`, and the function that executes one.

Each command imports its libraries when it runs, so that no other command waits for those of the page or of the
simulation.
"""

from __future__ import annotations

import errno
import sys
from collections.abc import Callable

import structlog
import tyro

from app.access.admission import PortTaken
from app.cli.compare import compare
from app.cli.export import export
from app.cli.figures import figures
from app.cli.lesson import ACTIONS, lesson
from app.cli.list import list_
from app.cli.options import UnwritableOutput
from app.cli.output import told
from app.cli.overview import overview
from app.cli.response import response
from app.cli.run import run
from app.cli.serve import serve
from app.cli.status import BAD_INPUT, DONE, FAULT
from app.cli.sweep import sweep
from app.cli.sweep_plot import sweep_plot
from app.cli.tune import tune
from app.cli.typed_options import require_options
from app.process import log
from app.process.terminal_text import printable
from app.scenario.errors import ScenarioError
from parameters import allowed

events = structlog.get_logger()

OPTIONS = (tyro.conf.DisallowNone,)  # an option that is not typed has no value to type
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EFBIG)

DEFAULT = "serve"  # command that runs where none is typed
COMMANDS: dict[str, Callable[..., int]] = {
    "serve": serve,
    "run": run,
    "compare": compare,
    "export": export,
    "response": response,
    "sweep": sweep,
    "tune": tune,
    "figures": figures,
    "lesson": lesson,
    "list": list_,
}

# commands that are typed behind the name of another one, by that name
SUBCOMMANDS: dict[str, dict[str, Callable[..., int]]] = {"sweep": {"plot": sweep_plot}, "lesson": ACTIONS}


def execute(arguments: list[str]) -> int:
    """Execute the command with these arguments; returns its exit status, see `app.__main__`. Raises
    KeyboardInterrupt, and SystemExit after the --help of a command."""
    log.configure_as_parent()
    if not arguments or (arguments[0].startswith("-") and arguments[0] not in ("-h", "--help")):
        arguments = [DEFAULT, *arguments]
    if arguments[0] in ("-h", "--help"):
        for line in overview(COMMANDS, DEFAULT):
            print(line)
        return DONE
    if arguments[0] not in COMMANDS:
        given = printable(arguments[0]) or "an empty text"
        print(f"vsmrc: {given}: no such command; {allowed(arguments[0], COMMANDS)}", file=sys.stderr)
        return BAD_INPUT
    try:
        return _call(arguments[0], arguments[1:])
    except (ScenarioError, PortTaken) as error:
        print(f"vsmrc: {told(str(error))}", file=sys.stderr)
        return BAD_INPUT
    except UnwritableOutput as error:
        print(f"vsmrc: {printable(str(error))}", file=sys.stderr)
        return FAULT
    except Exception as error:
        if isinstance(error, OSError) and error.errno in FULL and error.filename is None:
            print(f"vsmrc: a file cannot be written: {error.strerror}", file=sys.stderr)
            return FAULT
        events.info("fault", stage=arguments[0], exc_info=error)
        print(f"vsmrc: internal error: {printable(f'{type(error).__name__}: {error}')}", file=sys.stderr)
        return FAULT


def _call(name: str, typed: list[str]) -> int:
    """Execute the command of this name with what was typed behind it; returns its exit status. Raises ScenarioError."""
    related = {f"{name} {action}": command for action, command in SUBCOMMANDS.get(name, {}).items()}
    inner = f"{name} {typed[0]}" if typed else name
    if inner in related:
        others = {name: COMMANDS[name], **related}
        command = others.pop(inner)
        require_options(inner, command, typed[1:], others)
        return tyro.cli(command, args=typed[1:], prog=f"vsmrc {inner}", config=OPTIONS)
    require_options(name, COMMANDS[name], typed, related)
    return tyro.extras.subcommand_cli_from_dict(COMMANDS, args=[name, *typed], prog="vsmrc", config=OPTIONS)
