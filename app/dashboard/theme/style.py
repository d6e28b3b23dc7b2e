"""Style sheet and script of the page, injected as HTML; they are in `static/page`, fonts in `static/fonts`.

viser's text field sends every keystroke and has no event for "Enter or leaving the field". `rows.js` sees both: it
appends the character ENTERED to the text on Enter and LEFT when the field is left, so a commit is an ordinary change
of the value. (A submit of viser's form would not do: the client has one throttled message slot, and a submit within
50 ms of the last keystroke replaces that keystroke.)

viser's slider has no event for "let go" either. The script notes which row's slider is held, by mouse, finger or arrow
key. When it is let go, the script waits until the slider's last position has been sent, and then appends RELEASED, or
ESCAPED after the key Esc, to the text of the same row. In the same way `rowmenu.js` reports a choice from a row's
context menu: SWEPT for a robustness map over the row's field, MOVED for a search for gains that may vary it.
"""

from __future__ import annotations

from importlib import resources

from app.dashboard.theme.colors import css_variables
from app.dashboard.theme.fonts import font_faces

# zero width: never typed, never seen
LEFT, RELEASED, ESCAPED, SWEPT, MOVED, ENTERED = MARKS = "\u200b", "\u200c", "\u200d", "\u2060", "\u2061", "\u2062"
COMMITS = LEFT, ENTERED

_SHEETS = ("page.css", "phone.css")
_SCRIPTS = (
    "typed.js",
    "live.js",
    "points.js",
    "fonts.js",
    "rows.js",
    "plots.js",
    "reading.js",
    "symbols.js",
    "held.js",
    "scene.js",
    "labels.js",
    "coarse.js",
    "docks.js",
    "whatif.js",
    "stage.js",
    "names.js",
    "uploads.js",
    "visible_parts.js",
    "keys.js",
    "hints.js",
    "lessons.js",
    "palette.js",
    "poles.js",
    "tiles.js",
    "rowmenu.js",
)

# Scripts in innerHTML do not run; the load event of an image that is part of the page does, and needs no request.
_PIXEL = "data:image/gif;base64,R0lGODlhAQABAAAAACH5BAEKAAEALAAAAAABAAEAAAICTAEAOw=="


def without_marks(text: str) -> str:
    """Text of a field without the marks of the page's scripts."""
    return text.rstrip("".join(MARKS))


def injected_html() -> str:
    """The style sheet and the script, as an invisible piece of HTML."""
    # a client that lost its connection gets this HTML again; the script runs once
    blocks = "".join(f"{{\n{_read(name)}}}\n" for name in _SCRIPTS)
    # the sheet leaves the panel, which viser may take down
    kept = 'document.body.append(document.querySelector("#vs-sheet"));'
    script = f"if (!window.vsmrcLab) {{\nwindow.vsmrcLab = true;\n{kept}\n{blocks}}}"
    script = script.replace("&", "&amp;").replace('"', "&quot;")
    sheet = font_faces() + css_variables() + "".join(_read(name) for name in _SHEETS)
    return f'<style id="vs-sheet">{sheet}</style><img src="{_PIXEL}" style="display:none" onload="{script}">'


def _read(name: str) -> str:
    return resources.files("static").joinpath("page", name).read_text(encoding="utf-8")
