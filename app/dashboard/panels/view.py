"""View panel: content of the scene, camera, and action of the mouse in the scene. State of the page, which does not
affect the run."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar, Protocol

import viser

from app.dashboard.scene.camera import VIEWS, fly, viewpoint
from app.dashboard.transport.page_values import PageEvent, from_pages
from app.dashboard.view_options import FINE, LIGHT, SceneOptions, Viewing
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.run.scene_legend import legend_html
from app.session.snapshot import Snapshot
from environments.push import MOST_FORCE, MOST_MOMENT, MOST_STIFF, MOST_TORSION

SWITCHES = {
    "ghost": (
        "Ghost",
        "A second arm that follows the target model (8) exactly, from the last change on, driven by the force that the "
        "arm felt. The two arms part because of the residual of (8).",
    ),
    "pinned_arms": ("Pinned runs", "The arms of pinned runs (tab Runs), each in its own colour, at the same instant."),
    "desired_path": ("Desired path", "The path that the tool should have followed."),
    "tool_path": ("Tool path", "The path that the tool has taken."),
    "error_colors": (
        "Error colours",
        "Colours the tool's path by its distance from the desired point; on a surface, by the part along it.",
    ),
    "forces": ("Forces", "The force on the surface and the desired force, to scale."),
    "frame": (
        "Task frame",
        "Normal and tangents at the tool, in the colours that their coordinates have in the plots.",
    ),
    "spring": (
        "Spring and damper",
        "The target model's K_m and B_m, between the desired point and the tool; not drawn where shorter than 6 mm.",
    ),
    "surface": ("Surface", "The surface that the tool works on."),
    "grid": ("Grid", "The floor, squares of 0.1 m."),
}
SCALES: dict[str, float | None] = {"automatic": None} | {
    f"100 mm = {n:g} N": n for n in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
}
TIMES: dict[str, float] = {"to scale": 1.0} | {f"{n:g} times as large": n for n in (10.0, 100.0, 1000.0)}
MESHES = {"fine": FINE, "light": LIGHT}
DRAGS = {
    "pushes it (Shift: moves the target)": "push",
    "turns it (Shift: pushes)": "turn",
    "moves the target (Shift: pushes)": "target",
}


class _Widget(Protocol):
    value: Any

    def on_update(self, func: Any) -> Any: ...


class _Field:
    """Widget of one field of the scene options. choices: values by the text shown, None for a widget of the value
    itself."""

    def __init__(
        self, viewing: Viewing, name: str, widget: _Widget, choices: Mapping[str, object] | None = None
    ) -> None:
        self._viewing, self._name, self._widget, self._choices = viewing, name, widget, choices
        widget.on_update(from_pages(self._on_update))

    async def _on_update(self, _: PageEvent) -> None:
        shown = self._widget.value
        value = shown if self._choices is None else self._choices[shown]
        self._viewing.scene_options = replace(self._viewing.scene_options, **{self._name: value})

    def show(self, options: SceneOptions) -> None:
        value = getattr(options, self._name)
        if self._choices is not None:
            value = next(title for title, choice in self._choices.items() if choice == value)
        self._widget.value = value


class ViewPanel:
    """View panel: camera, legend, switches for the drawn objects, and the mouse."""

    holds: ClassVar = "camera, what is drawn, force arrows, mouse on the tool"

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._flights: set[asyncio.Task[None]] = set()
        gui, viewing = desk.gui, desk.viewing
        self._camera = gui.add_button_group(
            "Camera", VIEWS, hint="Turn and zoom with the mouse; these views bring you back."
        )
        self._camera.on_click(self._on_camera)
        with gui.add_folder("Drawn"):
            self._fields = [
                _Field(viewing, name, gui.add_checkbox(title, getattr(viewing.scene_options, name), hint=hint))
                for name, (title, hint) in SWITCHES.items()
            ]
            self._fields += [
                _Field(
                    viewing,
                    "times",
                    gui.add_dropdown("Deflection", tuple(TIMES), hint="Length of the spring and damper drawn."),
                    TIMES,
                ),
                _Field(viewing, "newtons", gui.add_dropdown("Force arrows", tuple(SCALES)), SCALES),
                _Field(
                    viewing, "cell", gui.add_dropdown("Meshes", tuple(MESHES), hint="Light: for slow graphics."), MESHES
                ),
            ]
            self._legend = gui.add_html("")  # below the switches: it has a row more or less when one is pressed
        with gui.add_folder("Mouse on the tool"):
            gui.add_html(
                '<div class="vs-note">Drag the ball at the tool: a spring pulls the arm towards the pointer. With '
                "Shift, or as chosen here, the drag does something else: it moves the desired path once you let go, or "
                "turns the tool by a torsional spring.</div>"
            )
            self._fields += [
                _Field(viewing, "drag", gui.add_dropdown("Dragging", tuple(DRAGS)), DRAGS),
                _Field(viewing, "stiffness", gui.add_slider("spring [N/m]", 50.0, MOST_STIFF, 50.0, 500.0, marks=())),
                _Field(viewing, "limit", gui.add_slider("at most [N]", 5.0, MOST_FORCE, 5.0, 60.0, marks=())),
                _Field(viewing, "torsion", gui.add_slider("turns [N·m/rad]", 5.0, MOST_TORSION, 5.0, 30.0, marks=())),
                _Field(viewing, "moment_limit", gui.add_slider("at most [N·m]", 0.5, MOST_MOMENT, 0.5, 5.0, marks=())),
            ]

    async def _on_camera(self, event: viser.GuiEvent) -> None:
        if event.client is not None:
            view = viewpoint(event.target.value, self._desk.snapshot())
            flight = asyncio.create_task(fly(event.client.camera, view))
            self._flights.add(flight)
            flight.add_done_callback(self._flights.discard)

    def show(self, snapshot: Snapshot) -> None:
        viewing = self._desk.viewing
        self._legend.content = (
            f'<div class="vs-note">{legend_html(viewing.scene_options, viewing.legend, snapshot)}</div>'
        )
        for field in self._fields:
            field.show(viewing.scene_options)
