"""Labels of widgets that change while the page is shown."""

from __future__ import annotations

from typing import Any

import viser

Labelled = viser.GuiInputHandle[Any] | viser.GuiButtonHandle | viser.GuiButtonGroupHandle | viser.GuiFolderHandle


def relabel(handle: Labelled, label: str) -> None:
    """Give a widget this label; nothing is sent where it has it already."""
    if handle.label != label:
        handle.label = label
