"""Fonts with which the text of a page is drawn."""

from __future__ import annotations

import time

from playwright.sync_api import Error, Page

from tests.support.layout import SETTLED

TEXTS = """[...document.querySelectorAll("body *")].filter((e) => e.checkVisibility() && !/STYLE|SCRIPT/.test(e.tagName)
  && [...e.childNodes].some((node) => node.nodeType === Node.TEXT_NODE && node.data.trim()))"""
# the same text in the same style has the same fonts: it is looked at under the first tab that shows it
_MARK = f"""() => {{
  const known = (window.textKnown ??= new Set());
  for (const e of document.querySelectorAll("[data-text]")) e.removeAttribute("data-text");
  for (const e of {TEXTS}) {{
    const {{ fontFamily, fontWeight, fontStyle, fontVariant, textTransform }} = getComputedStyle(e);
    const text = [...e.childNodes].map((node) => (node.nodeType === Node.TEXT_NODE ? node.data : "")).join();
    const key = [text, e.className, fontFamily, fontWeight, fontStyle, fontVariant, textTransform].join();
    if (!known.has(key)) e.setAttribute("data-text", "");
    known.add(key);
  }}
}}"""


def strangers(page: Page) -> list[str]:
    """One line for each text that was drawn with a font of the machine, not seen before; best an empty list."""
    until = time.monotonic() + SETTLED
    while True:
        try:
            return _strangers(page)
        except Error as error:
            if "Could not find node" not in error.message or time.monotonic() > until:
                raise
            page.evaluate("delete window.textKnown")  # a text was sent again meanwhile: all are looked at once more


def _strangers(page: Page) -> list[str]:
    page.evaluate(_MARK)
    devtools = page.context.new_cdp_session(page)
    devtools.send("DOM.enable")
    devtools.send("CSS.enable")
    root = devtools.send("DOM.getDocument")["root"]["nodeId"]
    found = set[str]()
    for node in devtools.send("DOM.querySelectorAll", {"nodeId": root, "selector": "[data-text]"})["nodeIds"]:
        fonts = devtools.send("CSS.getPlatformFontsForNode", {"nodeId": node})["fonts"]
        if foreign := [font["familyName"] for font in fonts if not font["isCustomFont"]]:
            html = devtools.send("DOM.getOuterHTML", {"nodeId": node})["outerHTML"]
            found.add(f"{foreign}: {html[:300]}")
    devtools.detach()
    return sorted(found)
