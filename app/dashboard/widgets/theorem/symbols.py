"""Symbols of the page: the glossary as a template for the page's script, and the present values."""

from __future__ import annotations

import time
from html import escape

import msgspec
import viser

from app.analysis.glossary import GLOSSARY, Symbol
from app.session.snapshot import Snapshot

EVERY = 0.5  # s, between two updates of the values


class Symbols:
    """Glossary, which `static/page/symbols.js` shows as tips and as a page, and the symbols' present values."""

    def __init__(self, gui: viser.GuiApi) -> None:
        gui.add_html(glossary_html())
        self._values = gui.add_html("")
        self._due = 0.0

    def show(self, snapshot: Snapshot) -> None:
        """Send the values every EVERY s; viser sends only changed ones."""
        if (now := time.monotonic()) >= self._due:
            self._due = now + EVERY
            self._values.content = values_html(snapshot)


def glossary_html() -> str:
    """Glossary as HTML: every symbol with its sentence, unit and equation, in a template, which is invisible by
    itself."""
    entries = "".join(map(_entry, GLOSSARY))
    return f'<template id="vs-symbols"><dl>{entries}</dl></template>'


def _entry(symbol: Symbol) -> str:
    names = "|".join((symbol.written, *symbol.also))
    units = " or ".join(dict.fromkeys(unit for unit in (symbol.unit, symbol.joint_unit) if unit not in ("", "1")))
    unit = f' <span class="vs-unit">[{escape(units)}]</span>' if units else ""
    equation = "equations" if "," in symbol.equation else "equation"
    cited = f" <cite>{equation} {escape(symbol.equation)} of the paper</cite>" if symbol.equation else ""
    sentence = symbol.meaning[:1].upper() + symbol.meaning[1:] if symbol.meaning[:2].islower() else symbol.meaning
    return (
        f'<div data-of="{escape(symbol.written)}" data-names="{escape(names)}"><dt>{escape(symbol.written)}</dt>'
        f"<dd>{escape(sentence.rstrip('.'))}.{unit}{cited}</dd></div>"
    )


def values_html(snapshot: Snapshot) -> str:
    """Present values of the symbols, as invisible HTML."""
    recording, t = snapshot.recording, snapshot.t
    row = recording.at(t) if len(recording) and t >= recording.first else {}
    values = {
        symbol.written: value
        for symbol in GLOSSARY
        if (row or not symbol.signal) and (value := symbol.value(row, snapshot.system, snapshot.matrices))
    }
    return f'<data data-live id="vs-values" value="{escape(msgspec.json.encode(values).decode())}"></data>'
