"""Text of an SVG."""

from __future__ import annotations

from xml.etree import ElementTree


def letters_of(svg: bytes) -> str:
    """All text of a figure, run after run; the letters of a symbol stand side by side."""
    return " ".join(texts_of(svg))


def texts_of(svg: bytes) -> list[str]:
    """Texts of a figure; the letters of a symbol stand side by side."""
    texts = ElementTree.fromstring(svg).iter("{http://www.w3.org/2000/svg}text")
    return ["".join(part.strip("\n ") or " " * bool(part == " ") for part in text.itertext()) for text in texts]
