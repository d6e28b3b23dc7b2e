"""Commands shown in README.md and docs/: their parsers accept them, simulations run, shown output is true."""

from __future__ import annotations

import functools
import importlib.util
import inspect
import re
import runpy
import shlex
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import tyro

from app.cli.commands import COMMANDS, execute
from app.cli.export import KINDS_OF_FILES
from app.cli.serve import LEVELS, THEMES, TOKENS
from app.cli.status import DONE, UNPROMISED
from app.evidence.sections import SECTIONS
from app.scenario.data import load
from fuzzing import TARGETS
from tests.support.pages import PAGES, ROOT, Command, Page

RUN_HERE = ("run", "compare", "export", "list_", "response")
SHOWN = [(page, command) for page in PAGES for command in page.commands]
SHORT = 0.05  # s of simulated time

pytestmark = [
    pytest.mark.slow,  # simulations, as pages show them
    pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning"),  # runpy, of what we import
]


class Call(NamedTuple):
    """What a parser would have called."""

    function: Callable[..., Any]
    arguments: dict[str, Any]


Parse = Callable[..., Call]


@pytest.fixture
def parse(monkeypatch: pytest.MonkeyPatch) -> Parse:
    """`vsmrc ...` or `python -m MODULE ...` as its own parser reads it; nothing runs. SystemExit: not accepted."""
    calls: list[Call] = []

    def recorded(function: Callable[..., Any]) -> Callable[..., int]:
        @functools.wraps(function)
        def record(*args: object, **kwargs: object) -> int:
            bound = inspect.signature(function).bind(*args, **kwargs)
            bound.apply_defaults()
            calls.append(Call(function, dict(bound.arguments)))
            return 0

        return record

    tyro_cli = tyro.cli
    monkeypatch.setattr(tyro, "cli", lambda function, **how: tyro_cli(recorded(function), **how))
    for name, command in COMMANDS.items():
        monkeypatch.setitem(COMMANDS, name, recorded(command))

    def parse(*words: str) -> Call:
        if words[0] == "vsmrc":
            assert execute([*words[1:]]) == 0
        else:
            monkeypatch.setattr(sys, "argv", [*words[2:]])
            try:
                runpy.run_module(words[2], run_name="__main__")
            except SystemExit as ended:
                if ended.code:
                    raise
        return calls.pop()

    return parse


def check(words: list[str], parse: Parse) -> None:
    """Raise where a command does not exist or does not take its arguments."""
    match words:
        case ["make", target, *settings]:
            assert [s for s in settings if not s.startswith("ARGS=")] == []
            recipes = recipes_with(target, " ".join(s.removeprefix("ARGS=") for s in settings))
            assert recipes or not settings, f"make {target} takes no ARGS"
            for recipe in recipes:
                if has_parser(recipe):
                    check(recipe, parse)
                elif recipe[:3] == ["python", "-m", "pytest"]:
                    assert all((ROOT / s.removeprefix("ARGS=")).exists() for s in settings), "no such tests"
                else:
                    assert not settings, f"nothing says what {shlex.join(recipe)} takes"
        case ["python", "-m", "app", *arguments]:
            check(["vsmrc", *arguments], parse)
        case ["vsmrc", "--version"]:  # has a test of its own
            pass
        case ["vsmrc", name] | ["vsmrc", name, "--help"]:
            assert name in COMMANDS
            with pytest.raises(SystemExit, match=r"^0$"):
                execute([name, "--help"])
        case _:
            call = parse(*words)
            if call.function.__name__ == "serve":
                load(call.arguments["scenario"])
                for name, allowed in (("theme", THEMES), ("token", TOKENS), ("log_level", (None, *LEVELS))):
                    assert call.arguments[name] in allowed
            elif call.function.__name__ == "export":
                assert {*call.arguments["to"]} <= {*KINDS_OF_FILES}
            elif call.function.__name__ == "figures":
                assert {*call.arguments["only"]} <= {section.name for section in SECTIONS}
            elif call.function.__name__ == "fuzz":
                assert {*call.arguments["only"]} <= TARGETS.keys()


def recipes_with(target: str, arguments: str) -> list[list[str]]:
    """The commands of a target of the Makefile that take ARGS, with these, and of the targets that it makes."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ")
    rule = re.search(rf"^{re.escape(target)}:.*\n((?:\t.*\n)+)", makefile, re.MULTILINE)
    assert rule, f"make {target}: no such target"
    lines = [line.strip("\t@").replace("$(BIN)/", "") for line in rule[1].splitlines()]
    made = [word for line in lines if line.startswith("$(MAKE)") for word in line.split() if f"\n{word}:" in makefile]
    own = [shlex.split(line.replace("$(ARGS)", arguments)) for line in lines if "$(ARGS)" in line]
    return own + [recipe for other in made for recipe in recipes_with(other, arguments)]


def has_parser(words: list[str]) -> bool:
    """Whether the command reads its arguments with tyro, as ours do; pytest does not."""
    if words[0] == "vsmrc":
        return True
    spec = importlib.util.find_spec(words[2])
    if spec and spec.submodule_search_locations:
        spec = importlib.util.find_spec(f"{words[2]}.__main__")
    assert spec is not None, f"{shlex.join(words)}: no such module"
    return "tyro.cli(" in Path(str(spec.origin)).read_text(encoding="utf-8")


@pytest.mark.parametrize(("page", "command"), SHOWN, ids=str)
def test_each_command_is_accepted(page: Page, command: Command, parse: Parse) -> None:
    del page
    check([*command.words], parse)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("vsmrc simulate", "assert 'simulate' in "),
        ("vsmrc run ur5-hybrid --duration 5", "vsmrc: run: no --out;"),
        ("vsmrc run ur5-hybrid --out out --durations 5", "vsmrc: run: --durations: no such option;"),
        ("vsmrc export ur5-hybrid --out out --to gif", "assert {'gif'} <= "),
        ("vsmrc figures --out out --only theorems", "assert {'theorems'} <= "),
        ("vsmrc serve ur5-hybird --fps 10", "scenario 'ur5-hybird': unknown;"),
        ("vsmrc serve --theme blue", "assert 'blue' in "),
        ("make tests", "make tests: no such target"),
        ('make check ARGS="--quick"', "make check takes no ARGS"),
        ("make run PORT=1", "assert ['PORT=1'] == []"),
        ('make run ARGS="--ports 1"', "vsmrc: serve: --ports: no such option;"),
        ('make bench ARGS="--only steps"', "invalid choice 'steps' for argument '--only'"),
        ('make fuzz ARGS="--only urdfs"', "assert {'urdfs'} <= "),
        ("python -m benchmarks.soaks --minutes 1", "No module named benchmarks.soaks"),
    ],
)
def test_a_command_that_does_not_exist_is_found(
    text: str, message: str, parse: Parse, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises((AssertionError, ImportError, SystemExit, ValueError)) as refused:
        check(shlex.split(text), parse)
    assert message in f"{refused.value} {' '.join(capfd.readouterr().err.split())}"


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_no_command_stands_in_a_block_that_is_not_read(page: Page) -> None:
    assert page.hidden == []


@pytest.mark.parametrize("page", sorted({page for page, c in SHOWN if not c.in_prose}, key=str), ids=str)
def test_simulations_of_a_page_run_one_after_the_other(
    page: Page, parse: Parse, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "tests" / "support" / "robots" / "bent3r.urdf", "arm.urdf")
    shutil.copytree(ROOT / "docs" / "examples", "docs/examples")
    for command in page.commands:
        if command.in_prose or command.output or command.words[0] != "vsmrc" or "--help" in command.words:
            continue
        call = parse(*command.words)
        if call.function.__name__ in RUN_HERE and call.arguments.get("from_") is None:  # of a sweep, which takes longer
            assert run_shortly(call) in (DONE, UNPROMISED), command


def run_shortly(call: Call) -> int:
    """The exit status of a simulation of a few steps."""
    arguments = dict(call.arguments)
    if "duration" in arguments:
        arguments["duration"] = SHORT
        if arguments.get("last") is not None:
            arguments["last"] = SHORT
        if arguments.get("blend_at") is not None:
            arguments["blend_at"] = 0.0
    elif "at" in arguments:
        arguments["at"] = min(arguments["at"], SHORT)
    elif "start" in arguments:
        arguments |= {"start": 0.0, "end": SHORT}
        if not arguments["run"].endswith(".npz"):
            arguments["settings"] += ((f"simulation.duration={SHORT}",),)
    bound = inspect.BoundArguments(inspect.signature(call.function), arguments)  # type: ignore[arg-type]
    return call.function(*bound.args, **bound.kwargs)


@pytest.mark.parametrize("command", [command for _, command in SHOWN if command.output], ids=str)
def test_shown_output_is_what_the_command_prints(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    execute([*command.words[1:]])
    assert "".join(capsys.readouterr()).split() == command.output.split()
