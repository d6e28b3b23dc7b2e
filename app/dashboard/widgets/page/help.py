"""Help for newcomers: where to start, the keys, the colours, further reading; and first steps, shown once."""

from __future__ import annotations

from collections.abc import Callable

import viser

from app.dashboard.theme.colors import BOUND, DESIRED, MEASURED, SURFACE, Rgb, css
from controllers.modes import MODES

# Text of each key in viser's palette, except for V, "?" and Esc, which the page's script adds.
KEYS: dict[str, str] = {
    "space": "play or pause",
    "arrowright": "one control period forward",
    "arrowleft": "one control period back",
    "Shift+arrowright": "0.1 s on",
    "Shift+arrowleft": "0.1 s back",
    "end": "to the end of the run",
    "pageup": "previous event: an edit, a push, a contact",
    "pagedown": "next event",
    "Z": "revert what a slider has applied last",
    "F": "fork: from now on, play continues at the shown instant",
    "P": "pin this run, to compare it with others",
    "R": "reset: begin again at t = 0",
    **{str(number): mode.label.lower() for number, mode in enumerate(MODES.values(), start=1)},
    "L": "swap the law: robust, or computed torque",
    "B": "push the tool",
    "N": "see s reach zero, in slow motion",
    "O": "accept the fix that is offered after a refusal",
    "G": "a guided minute: the five modes",
    "J": "in a lesson: its next step",
    "K": "in a lesson: the step before",
    "T": "dark or light",
    "H": "this help, also ?",
}
_WRITTEN = {
    "arrowright": "→",
    "arrowleft": "←",
    "arrowup": "↑",
    "arrowdown": "↓",
    "pageup": "PgUp",
    "pagedown": "PgDn",
    "end": "End",
}

START = (
    "<b>Task</b>: choose a scenario or a mode. It begins at once; nothing has to be started.",
    "Hold a slider, there or in any tab: the plots show what its value would do. Let go to apply it, or press "
    "<kbd>Esc</kbd> to cancel. Or type a number and press Enter.",
    "<b>Model</b>: choose the behaviour you want. The equation under <i>Target model</i> shows its numbers; grey "
    "numbers are fixed by the mode.",
    "<b>Robot</b> and <b>World</b>: make the true arm differ from the controller's model, and watch whether ‖s‖ "
    "stays under its bound.",
)
COLORS: dict[str, Rgb] = {
    "desired: path, force": DESIRED,
    "measured: force": MEASURED,
    "bounds of the theorem; refused, stopped": BOUND,
    "the surface": SURFACE,
}
DOCUMENTS = {
    "README.md": "what it is, how to start, where to read on",
    "docs/dashboard.md": "the page: edits, what if, time, the scene, plots, keys",
    "docs/target-model.md": "the target model, its poles, the impedance that is felt",
    "docs/scenarios.md": "scenario files, task coordinates, how accurate the shipped ones are",
    "docs/surfaces.md": "formulas, corners, a flat tool",
    "docs/theory.md": "what the theorem promises, and when",
    "docs/sweeps.md": "robustness maps, many runs of a scenario",
    "docs/tuning.md": "the search for gains",
    "docs/scale.md": "sweeps on many machines",
    "docs/export.md": "figures, data, playback",
    "docs/lessons.md": "twelve lessons, and how to write one",
    "docs/command-line.md": "runs without a screen",
    "docs/extending.md": "a law, mode, surface, trajectory or arm of your own",
    "docs/symbols.md": "which symbol of the paper is which name in the code",
    "docs/evidence.md": "every claim checked against something independent",
    "docs/robots.md": "which arms, your own URDF, the true arm and its declared bounds",
    "docs/development.md": "folders, checks, benchmarks",
    "docs/mutations.md": "planted mistakes, and the tests that see them",
    "docs/performance.md": "speed, pacing, memory",
    "docs/security.md": "a server for an audience: links, tokens, limits",
    "docs/reliability.md": "what happens when something fails",
}
HINTS = (
    "<b>Hold a slider</b>: the plots on the left show what its value would do. Let go to apply it.",
    "<kbd>space</kbd> pauses, <kbd>R</kbd> resets the run, <kbd>1</kbd> to <kbd>5</kbd> change the mode.",
    "Other arms and tasks: <b>Scenario</b>, on the right. Everything else: <kbd>?</kbd>",
)


class Help:
    """Command that opens the help on the page that asked, or closes it."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._open: dict[int, Callable[[], None]] = {}  # closes the open help, by client
        server.gui.add_command("Help: keys, colours, where to start", hotkey="H").on_trigger(self._toggle)
        server.on_client_disconnect(self._forget)

    async def _toggle(self, event: viser.CommandEvent) -> None:
        client = event.client
        if client is None or self._close(client.client_id):
            return
        modal = client.gui.add_modal("VSMRC Lab")
        self._open[client.client_id] = modal.close
        with modal:
            close = client.gui.add_button("Close", hint="Esc")  # above a text that is longer than a phone
            client.gui.add_html(help_html())
        close.on_click(self._on_close)

    async def _on_close(self, event: viser.GuiEvent) -> None:
        if event.client is not None:
            self._close(event.client.client_id)

    def _close(self, client_id: int) -> bool:
        close = self._open.pop(client_id, None)
        if close is not None:
            close()
        return close is not None

    async def _forget(self, client: viser.ClientHandle) -> None:
        self._open.pop(client.client_id, None)


def help_html() -> str:
    """Text of the help. What only helps who steers is of the class vs-steers."""
    keys = "".join(f'<tr class="vs-steers"><td>{_keys(key)}</td><td>{does}</td></tr>' for key, does in KEYS.items())
    keys += f"<tr><td>{_key('V')}</td><td>presentation: scene, one plot, the sliders used last, large type</td></tr>"
    keys += f"<tr><td>{_key(',')} {_key('.')}</td><td>in a presentation: the plot before, the next plot</td></tr>"
    keys += f'<tr class="vs-steers"><td>{_key("Ctrl")} {_key("K")}</td><td>search all commands</td></tr>'
    colors = "".join(
        f'<tr><td><span class="vs-swatch" style="background: {css(color)}"></span></td><td>{meaning}</td></tr>'
        for meaning, color in COLORS.items()
    )
    documents = "".join(f"<tr><td>{name}</td><td>{about}</td></tr>" for name, about in DOCUMENTS.items())
    return (
        '<div class="vs-help">'
        '<p><button type="button" data-glossary>Every symbol of the page</button> '
        '<button type="button" data-presents>Presentation</button> '
        '<button type="button" class="vs-steers" data-key="g">A guided minute</button></p>'
        f'<div><div class="vs-steers"><h3>Where to start</h3><ul>{_items(START)}</ul></div>'
        f"<h3>Colours</h3><table>{colors}</table></div>"
        f"<div><h3>Keys</h3><table>{keys}</table><h3>In the project's folder</h3><table>{documents}</table></div>"
        "</div>"
    )


def tools_html() -> str:
    """Buttons beside the title, each of which presses a key, the first steps, which the page's script shows once, and
    the help for a page that only watches."""
    hints = "".join(f"<p>{hint}</p>" for hint in HINTS)
    return (
        '<div class="vs-tools">'
        '<button data-key="t" title="dark or light (T)" aria-label="dark or light"><i class="vs-half"></i></button>'
        '<button data-key="h" title="help (?)" aria-label="help">?</button></div>'
        '<template id="vs-hints"><aside class="vs-hints" role="note" aria-label="first steps">'
        f'{hints}<button data-key="g">A guided minute</button><button data-tab="Lessons">Lessons</button>'
        "<button>Got it</button></aside></template>"
        f'<template id="vs-help">{help_html()}</template>'
    )


def _items(texts: tuple[str, ...]) -> str:
    return "".join(f"<li>{text}</li>" for text in texts)


def _keys(together: str) -> str:
    return " ".join(_key(_WRITTEN.get(key, key)) for key in together.split("+"))


def _key(name: str) -> str:
    return f"<kbd>{name}</kbd>"
