"""Fonts of the page, as a style sheet that contains them: the page depends on no font that a machine has installed.

The files lie in `static/fonts`, whose README says how they were made.
"""

from __future__ import annotations

import base64
from functools import cache
from importlib import resources
from typing import NamedTuple


class FontFace(NamedTuple):
    """Face: one file of a font family. weight: of CSS, 400 for regular."""

    family: str
    file: str
    weight: int = 400


TEXT, MONO, MATH = "vsmrc text", "vsmrc mono", "vsmrc math"
FACES = (
    FontFace(TEXT, "arimo-regular.woff2"),
    FontFace(TEXT, "arimo-bold.woff2", weight=700),
    FontFace(MONO, "cousine-regular.woff2"),
    FontFace(MATH, "termes-math.woff2"),
)


@cache
def font_faces() -> str:
    """Rules `@font-face` of all families. They contain the fonts' data, so that a gateway or a proxy needs no route."""
    return "".join(
        f'@font-face {{ font-family: "{face.family}"; font-weight: {face.weight}; font-display: block;'
        f' src: url("data:font/woff2;base64,{_data(face.file)}") format("woff2"); }}\n'
        for face in FACES
    )


def _data(file: str) -> str:
    return base64.b64encode(resources.files("static").joinpath("fonts", file).read_bytes()).decode("ascii")
