"""Report of the tests that failed, from the JUnit files that pytest writes: `python -m drivers.failures FILE...`.

`make test` ends with it: a part that runs longer than the one that failed prints its thousands of lines last.
"""

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from xml.etree import ElementTree

SHOWN = 15  # last lines of a failure, which say what was expected and where


def failures(files: Iterable[Path]) -> Iterator[str]:
    """Name and last lines of each test that failed, or whose setup or teardown did; a sentence for a part of the tests
    that did not come to its end, and so has written no file."""
    for file in files:
        try:
            cases = ElementTree.parse(file).iter("testcase")
        except (OSError, ElementTree.ParseError):
            yield f"{file}: no report of this part; see what it printed"
            continue
        for case in cases:
            for outcome in case:
                if outcome.tag in ("failure", "error"):
                    name = ".".join(filter(None, (case.get("classname"), case.get("name"))))
                    lines = (outcome.text or "").rstrip().splitlines()[-SHOWN:]
                    yield "\n".join([f"{outcome.tag.upper()} {name}: {outcome.get('message', '')[:200]}", *lines])


if __name__ == "__main__":
    print(*failures(map(Path, sys.argv[1:])), sep="\n\n")
