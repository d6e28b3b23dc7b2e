"""Links and names in README.md and docs/: each file, heading, test, option and scenario field exists."""

from __future__ import annotations

import re

import pytest

from app.cli import commands
from app.scenario.field_info import types_of
from app.scenario.schema import Scenario
from tests.support.pages import PAGES, ROOT, Page

LINK = re.compile(r"\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)
COMMANDS = ("serve", "run", "compare", "export", "response", "sweep", "sweep plot", "tune", "figures", "lesson run",
            "list")  # fmt: skip
TESTS = {path.name: path for path in (ROOT / "tests").glob("*/test_*.py")}
FOLDERS = ("docs/", *(f"{path.parent.name}/" for path in ROOT.glob("*/__init__.py")))


@pytest.fixture(scope="module")
def tests() -> str:
    """The names of all tests, one a line."""
    return "\n".join(
        name for file in TESTS.values() for name in re.findall(r"def (test_\w+)", file.read_text(encoding="utf-8"))
    )


@pytest.fixture
def options(capsys: pytest.CaptureFixture[str]) -> set[str]:
    """The options of the commands."""
    for name in COMMANDS:
        with pytest.raises(SystemExit):
            commands.execute([*name.split(), "--help"])
    return set(re.findall(r"--[a-z-]+", capsys.readouterr().out))


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_links_lead_somewhere(page: Page) -> None:
    assert [link for link in LINK.findall(page.prose) if not leads_somewhere(page, link)] == []


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_names_of_files_tests_options_and_fields_exist(page: Page, tests: str, options: set[str]) -> None:
    fields = [span for span in page.spans if span.partition(".")[0] in Scenario.__struct_fields__]
    wrong = [span for span in page.spans if span.startswith(FOLDERS) and not any(ROOT.glob(span))]
    wrong += [span for span in page.spans if re.fullmatch(r"test_\w+\.py", span) and span not in TESTS]
    wrong += [span for span in page.spans if re.fullmatch(r"…\w+…?", span) and span.strip("…") not in tests]
    wrong += [span for span in page.spans if re.match(r"--[a-z]", span) and span.split()[0] not in options]
    wrong += [span for span in fields if re.fullmatch(r"\w+\.\w+", span) and not is_field(*span.split("."))]
    assert wrong == []


def is_field(section: str, name: str) -> bool:
    return any(name in kind.__struct_fields__ for kind in types_of(Scenario, section))


def leads_somewhere(page: Page, link: str) -> bool:
    """Whether a link of a page, relative or to the web, has a file and, after #, a heading there."""
    if link.startswith("https://"):
        return True
    path, _, anchor = link.partition("#")
    target = Page(page.path.parent / path) if path else page
    return target.path.exists() and (not anchor or anchor in map(slug, HEADING.findall(target.prose)))


def slug(heading: str) -> str:
    """The anchor that GitHub gives a heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
