"""Markup of lessons: formulas are set, and nothing of a text becomes markup or code."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import pytest

from app.lessons.markup import SETTING, html_of, inline_html

TEXT = {"p", "strong", "em", "code", "pre", "ul", "ol", "li", "h1", "table", "thead", "tbody", "tr", "th", "td", "br"}
MATH = {"math", "mrow", "mi", "mo", "mn", "msub", "msup", "msubsup", "mover", "munder", "mfrac", "msqrt", "mtext"}
ALLOWED = TEXT | MATH | {"span", "div"}


class Seen(HTMLParser):
    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: set[str] = set()
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}


@pytest.mark.parametrize(
    "attack",
    [
        "<img src=x onerror=alert(1)>",
        "<script>alert(1)</script>",
        "[x](javascript:alert(1))",
        "![x](http://example.org/x.png)",
        "<http://example.org>",
        "&lt;img src=x&gt; &#60;img src=x&#62;",
        r"$\text{<img src=x onerror=alert(1)>}$",
        r"$\text{&lt;img src=x onerror=alert(1)&gt;}$",
        r"$\href{javascript:alert(1)}{x}$",
        r"$\style{position:fixed}{x}$ $\class{vs-acts}{x}$",
        "$$</math><img src=x>$$",
        "```\n<b onclick=x>\n```",
        "| <i onclick=x> |\n| --- |\n| <u> |",
    ],
)
def test_nothing_of_a_text_becomes_markup(attack: str) -> None:
    for html in (html_of(attack, {}), inline_html(attack), html_of("{{way}}", {"way": "<b>15</b> mm"})):
        seen = Seen(html)
        assert seen.tags <= ALLOWED
        assert seen.attributes <= SETTING | {"class"}
        assert set(re.findall(r'class="([^"]*)"', html)) <= {"math inline", "math block"}


def test_formulas_are_set_and_measured_numbers_stand_in_the_text() -> None:
    html = html_of(r"With $\omega = \sqrt{K_m / M_m}$ it went {{way}}, not {{far}}.", {"way": "15 mm"})
    assert "<msqrt>" in html
    assert "<msub><mi>K</mi><mi>m</mi></msub>" in html
    assert "it went 15 mm, not …." in html
    assert 'display="block"' in html_of("$$x^2$$", {})
    assert inline_html("a **b**") == "a <strong>b</strong>"
