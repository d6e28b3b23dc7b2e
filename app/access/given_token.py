"""Token to steer that is given in a file or in the environment, instead of being made at the start."""

from __future__ import annotations

import re
from collections.abc import MutableMapping
from pathlib import Path

from app.process.redaction import SHORTEST
from app.scenario.errors import ScenarioError
from environments.regular_file import read_regular

VARIABLE = "VSMRC_TOKEN"
LONGEST = 200
_TOKEN = re.compile(rf"[A-Za-z0-9_-]{{{SHORTEST},{LONGEST}}}")
_ALLOWED = f"{SHORTEST} to {LONGEST} of the characters A-Z, a-z, 0-9, _ and -"


def given_token(file: Path | None, environment: MutableMapping[str, str]) -> str | None:
    """Token in the file, else in the environment, from which it is removed, so that no other process gets it; None
    where neither has one. Raises ScenarioError, without the token in its sentence."""
    inherited = environment.pop(VARIABLE, None)
    if file is not None:
        where = f"--token-file {file}"
        try:
            text = read_regular(file, 4 * LONGEST).decode("ascii", "replace").strip()
        except OSError as error:
            raise ScenarioError(f"{where}: cannot be read: {error.strerror}") from error
    elif inherited is not None:
        where, text = VARIABLE, inherited
    else:
        return None
    if not _TOKEN.fullmatch(text):
        raise ScenarioError(f"{where}: a token of {len(text)} characters; allowed: {_ALLOWED}")
    return text
