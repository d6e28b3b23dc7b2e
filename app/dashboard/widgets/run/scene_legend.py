"""Legend of the scene, its colours and lengths: over the scene behind a button, and in the tab View."""

from __future__ import annotations

from html import escape

from app.dashboard.theme.colors import (
    DESIRED,
    ERROR_COLORS,
    GHOST,
    MEASURED,
    MODEL,
    PUSH,
    RUNS,
    SERIES,
    TIP,
    TOOL_PATH,
    Rgb,
    css,
)
from app.dashboard.view_options import NEWTON_METRES, Legend, SceneOptions
from app.dashboard.widgets.fields.controls import Desk
from app.session.snapshot import Snapshot

_COARSE = (
    "This browser draws without a graphics card, or slowly: arms have fewer triangles on this page. "
    "Press to draw them whole, or coarse again."
)


class SceneLegend:
    """Legend over the scene, with the button that opens and closes it on the page where it is pressed. A button below
    it is visible only on a page that draws coarse arms (static/page/coarse.js)."""

    def __init__(self, desk: Desk) -> None:
        self._viewing = desk.viewing
        # two widgets: the legend is sent anew, whereas a button must not be replaced while it is pressed
        desk.gui.add_html(
            '<button class="vs-legend-button" title="What the colours in the scene mean">Legend</button>'
            f'<button class="vs-coarse-button" title="{_COARSE}" hidden>Coarse arms</button>'
        )
        self._html = desk.gui.add_html("")

    def show(self, snapshot: Snapshot) -> None:
        rows = legend_html(self._viewing.scene_options, self._viewing.legend, snapshot)
        self._html.content = f'<div class="vs-legend">{rows}</div>'


def legend_html(options: SceneOptions, legend: Legend, snapshot: Snapshot) -> str:
    """Rows of the legend as HTML, for the objects that are drawn."""
    lines = []
    if options.tool_path and options.error_colors and snapshot.tool_desired is not None:
        colors = ", ".join(css(color) for color in ERROR_COLORS)
        bar = f'<span class="vs-bar" style="background: linear-gradient(90deg, {colors})">'
        lines.append(f"<div class='vs-row'>path error&ensp;0 {bar}</span> {1e3 * legend.error:g} mm</div>")
    places = [_key(TIP, "tool tip")]
    if options.desired_path:
        places.append(_key(DESIRED, "desired"))
    if options.tool_path and not options.error_colors:
        places.append(_key(TOOL_PATH, "tool"))
    forces = [_key(MEASURED, "force"), _key(DESIRED, "desired force")] if options.forces else []
    if options.forces or snapshot.push.any():
        forces += [_key(PUSH, "push"), f"<span>100 mm = {legend.newtons:g} N</span>"]
    if snapshot.push_moment.any():
        forces.append(f"<span>turned: 100 mm = {NEWTON_METRES:g} N·m</span>")
    model, frame, arms = [], [], []
    if options.spring and snapshot.tool_desired is not None:
        times = "" if options.times == 1.0 else f", deflection × {options.times:g}"
        model.append(_key(MODEL, f"spring and damper of (8){times}"))
    if options.frame:
        positions = () if snapshot.system.layout.joint else snapshot.system.layout.position_indices
        frame += [_key(SERIES[i], snapshot.coordinates[i].name) for i in positions]
    if options.pinned_arms and snapshot.pinned:
        arms += [_key(RUNS[pinned.slot], escape(pinned.title)) for pinned in snapshot.pinned]
    if options.ghost and legend.ghost is not None:
        away = legend.ghost if isinstance(legend.ghost, str) else f"{1e3 * legend.ghost:.3f} mm away"
        arms.append(_key(GHOST, f"ghost, {away}"))
    lines += [f"<div class='vs-row'>{' '.join(keys)}</div>" for keys in (places, forces, model, frame, arms) if keys]
    return "".join(lines)


def _key(color: Rgb, name: str) -> str:
    dot = f'<span class="vs-dot" style="background: {css(color)}"></span>'
    return f"<span>{dot} {name}</span>"
