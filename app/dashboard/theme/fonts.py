"""The fonts of the page, as a style sheet that carries them: no page depends on what a machine has installed.

The files lie in `static/fonts`, whose README says how they were made.
"""

from __future__ import annotations

import base64
from functools import cache
from importlib import resources
from typing import NamedTuple


class Face(NamedTuple):
    """One file of a family. weight: of CSS, 400 for regular."""

    family: str
    file: str
    weight: int = 400


TEXT, MONO, MATH = "vsmrc text", "vsmrc mono", "vsmrc math"
FACES = (
    Face(TEXT, "arimo-regular.woff2"),
    Face(TEXT, "arimo-bold.woff2", weight=700),
    Face(MONO, "cousine-regular.woff2"),
    Face(MATH, "termes-math.woff2"),
)


@cache
def font_faces() -> str:
    """The families as `@font-face` rules. Their data stand in the rules, so a gateway or a proxy needs no route."""
    return "".join(
        f'@font-face {{ font-family: "{face.family}"; font-weight: {face.weight}; font-display: block;'
        f' src: url("data:font/woff2;base64,{_data(face.file)}") format("woff2"); }}\n'
        for face in FACES
    )


def _data(file: str) -> str:
    return base64.b64encode(resources.files("static").joinpath("fonts", file).read_bytes()).decode("ascii")
