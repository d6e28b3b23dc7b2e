"""Files of a user's own, named on the command line by `--use`: control laws beside those of the program.

Nothing else can name such a file, neither a scenario nor an upload nor a page. Processes that this one starts are told
by the environment.
"""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections.abc import Sequence
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from app.scenario.schema import ScenarioError
from controllers.control_law import ControlLaw
from controllers.laws.table import LAWS

VARIABLE = "VSMRC_USE"
_KIND, _NAME = re.compile("[a-z][a-z0-9]*(-[a-z0-9]+)*"), re.compile("[A-Za-z][A-Za-z0-9_]*")
_ALLOWED = "a Python file with LAW = ControlLaw(...), see docs/extending.md"


class OwnCodeError(ScenarioError):
    """A file of the user's own that cannot be used: one sentence with file, line and reason."""


def use(paths: Sequence[Path]) -> None:
    """From now on the laws of these files are there, in this process and in those that it starts. Raises
    OwnCodeError."""
    before = os.environ.get(VARIABLE, "")
    os.environ[VARIABLE] = os.pathsep.join(str(path.resolve()) for path in paths)
    own_laws.cache_clear()
    try:
        own_laws()
    except OwnCodeError:
        os.environ[VARIABLE] = before
        raise


@cache
def own_laws() -> dict[str, ControlLaw]:
    """The laws of the files that were named, by kind. Raises OwnCodeError."""
    found: dict[str, ControlLaw] = {}
    for path in filter(None, os.environ.get(VARIABLE, "").split(os.pathsep)):
        law = _law_of(Path(path))
        if law.kind in found:
            raise OwnCodeError(f"--use {path}: kind {law.kind!r} is that of another file; allowed: a kind of its own")
        found[law.kind] = law
    return found


def _law_of(path: Path) -> ControlLaw:
    spec = spec_from_file_location(f"own_{path.stem}", path)
    if path.suffix != ".py" or not path.is_file() or spec is None or spec.loader is None:
        raise OwnCodeError(f"--use {path}: no Python file; allowed: {_ALLOWED}")
    module = module_from_spec(spec)
    sys.modules[module.__name__] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise OwnCodeError(f"--use {located(error, path)}") from error
    law = getattr(module, "LAW", None)
    if not isinstance(law, ControlLaw):
        raise OwnCodeError(f"--use {path}: LAW is {'missing' if law is None else repr(law)[:60]}; allowed: {_ALLOWED}")
    _check(law, path)
    return law


def _check(law: ControlLaw, path: Path) -> None:
    if not _KIND.fullmatch(law.kind) or law.kind in LAWS:
        raise OwnCodeError(
            f"--use {path}: kind {law.kind!r:.60}; allowed: lower-case words joined by '-', but {', '.join(LAWS)}"
        )
    titles = [known.title for known in LAWS.values()]
    if not (isinstance(law.title, str) and isinstance(law.about, str)) or law.title in ("", *titles):
        raise OwnCodeError(f"--use {path}: title {law.title!r:.60}; allowed: text other than {', '.join(titles)}")
    if law.robust:
        raise OwnCodeError(f"--use {path}: robust = True; allowed: False, Theorem 1 is about (25) and no other law")
    for p in law.parameters:
        if not _NAME.fullmatch(p.name):
            raise OwnCodeError(f"--use {path}: parameter {p.name!r:.60}; allowed: letters, digits and '_'")
        if not p.low <= p.value <= p.high:
            raise OwnCodeError(f"--use {path}: {p.name} = {p.value:g}; allowed: {p.low:g} to {p.high:g}, its bounds")


def located(error: BaseException, path: Path) -> str:
    """What went wrong in a file, with the line of it that was reached last."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    if isinstance(error, SyntaxError) and error.filename == str(path):
        lines = [error.lineno]
    compiling = re.findall(rf'File "[^"]*{re.escape(path.name)}", line (\d+)', str(error))  # as numba says it
    line = compiling[-1] if compiling else lines[-1] if lines else None
    texts = [text.strip() for text in str(error).splitlines()]
    said = next((text for text in texts if text and not text.startswith("Failed in nopython mode")), "")
    said = re.sub(" of type .*| \\(.*, line \\d+\\)$", "", said)  # types as numba writes them fill pages
    where = str(path) if line is None else f"{path}, line {line}"
    return f"{where}: {type(error).__name__}: {said:.200}".rstrip(": ")
