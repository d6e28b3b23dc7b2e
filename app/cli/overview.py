"""Overview of the commands, which `vsmrc --help` prints."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Callable, Iterator, Mapping

INDENT = 12  # columns before what a command does
WIDEST = 100  # columns, more of which are hard to read


def overview(commands: Mapping[str, Callable[..., int]], default: str) -> Iterator[str]:
    """Lines on the usage of `vsmrc`, and the first sentence on each of its commands. default: the one that runs where
    none is typed."""
    width = min(shutil.get_terminal_size().columns, WIDEST)
    yield "usage: vsmrc [COMMAND] [OPTIONS]"
    yield "       vsmrc COMMAND --help"
    yield "       vsmrc --version"
    yield ""
    yield from textwrap.wrap(
        f"Without a command, vsmrc does what `vsmrc {default}` does, and takes its options, such as `vsmrc --port "
        "8081`.",
        width,
    )
    yield ""
    yield "commands:"
    for name, command in commands.items():
        described = " ".join((command.__doc__ or "").split())
        sentence = described.partition(". ")[0].rstrip(".") + "."
        if name == default:
            sentence += " This is the default."
        yield from textwrap.wrap(
            sentence, width, initial_indent=f"  {name:{INDENT - 2}s}", subsequent_indent=INDENT * " "
        )
