"""What axe-core finds on a page."""

from __future__ import annotations

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page

# What is viser's own and no attribute of ours can mend; nothing is, at present.
VISERS_OWN: frozenset[str] = frozenset()
_VIOLATIONS = """async (own) =>
  (await axe.run({ resultTypes: ["violations"] })).violations
  .filter(({ id }) => !own.includes(id))
  .flatMap(({ id, nodes }) => nodes.map(({ html }) => `${id}: ${html.slice(0, 160)}`))"""


def violations(page: Page) -> list[str]:
    """One line for each violation of axe-core's rules; best an empty list."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(Axe().axe_script)
    return page.evaluate(_VIOLATIONS, list(VISERS_OWN))
