"""What axe-core finds on a page."""

from __future__ import annotations

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page

# Tabs that were opened before stay in the page, hidden; axe-core would walk through all of their nodes.
# checkVisibility() is no measure here: what has `display: contents` counts as hidden there, with all that it shows.
_VIOLATIONS = """async () => {
  const away = [...document.body.querySelectorAll("*")]
    .filter((e) => getComputedStyle(e).display === "none" && e.querySelectorAll("*").length > 50)
    .map((e) => { const mark = document.createComment(""); e.replaceWith(mark); return [e, mark]; });
  try {
    return (await axe.run({ resultTypes: ["violations"] })).violations
      .flatMap(({ id, nodes }) => nodes.map(({ html }) => `${id}: ${html.slice(0, 160)}`));
  } finally {
    for (const [e, mark] of away.reverse()) mark.replaceWith(e);
  }
}"""


def violations(page: Page) -> list[str]:
    """One line for each violation of axe-core's rules; best an empty list. The run must be paused: meanwhile the page
    lacks what it does not show."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(Axe().axe_script)
    return page.evaluate(_VIOLATIONS)
