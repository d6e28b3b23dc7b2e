"""Markup of a lesson's text: Markdown, and `$…$` as MathML, to HTML in which nothing of the text is markup or code."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from html import escape, unescape
from xml.etree import ElementTree

from latex2mathml.converter import convert_to_element
from markdown_it import MarkdownIt
from mdit_py_plugins.dollarmath import dollarmath_plugin

from app.lessons.lesson import NAMED

UNKNOWN = "…"
# attributes of MathML that say how a formula is set; the library also has some that are links, styles or classes
SETTING = {
    *(
        "xmlns",
        "display",
        "displaystyle",
        "scriptlevel",
        "mathvariant",
        "mathsize",
        "mathcolor",
        "accent",
        "accentunder",
    ),
    *("fence", "form", "separator", "stretchy", "symmetric", "largeop", "movablelimits", "lspace", "rspace", "minsize"),
    *("maxsize", "width", "height", "depth", "voffset", "linethickness", "columnalign", "columnspacing", "rowspacing"),
}


def html_of(text: str, measured: Mapping[str, str]) -> str:
    """HTML of a lesson's Markdown, with measured numbers in place of {{names}}; an ellipsis for an unknown one."""
    filled = NAMED.sub(lambda name: measured.get(name[1], UNKNOWN), text)
    return _markdown().render(filled)


def inline_html(text: str, measured: Mapping[str, str] | None = None) -> str:
    """HTML of one line, without a paragraph."""
    filled = NAMED.sub(lambda name: (measured or {}).get(name[1], UNKNOWN), text)
    return _markdown().renderInline(filled)


def mathml(formula: str, *, display: bool = False) -> str:
    """MathML of a formula in TeX; the formula itself, as text, where it is none."""
    try:
        element = convert_to_element(formula, display="block" if display else "inline")
    except Exception:  # the library has no common exception for what it cannot read
        return f"<code>{escape(formula)}</code>"
    for each in element.iter():  # the library writes entities as text
        each.text = None if each.text is None else unescape(each.text)
        each.attrib = {name: value for name, value in each.attrib.items() if name in SETTING}
    # serialised here: what was text stays text
    return ElementTree.tostring(element, encoding="unicode")


@cache
def _markdown() -> MarkdownIt:
    markdown = MarkdownIt("commonmark", {"html": False}).enable("table")
    markdown.disable(["image", "link", "autolink", "html_inline"])
    markdown.use(
        dollarmath_plugin,
        allow_space=False,
        double_inline=True,
        renderer=lambda formula, options: mathml(formula, display=bool(options.get("display_mode"))),
    )
    return markdown
