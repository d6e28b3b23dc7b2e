"""Names of the files of the tab Export: the part of the run that is in them, and what they show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import MagicMock

import pytest
import viser

from app.dashboard.panels.export import SHOWN, WHOLE, ExportPanel
from app.dashboard.view_options import Viewing
from app.dashboard.widgets.fields.controls import Desk
from app.scenario.data import edited, load
from app.session.headless_run import simulate
from app.session.snapshot import snapshot_of

SECONDS = 1.0


@pytest.fixture(scope="module")
def name_of() -> Callable[..., str]:
    """Name of the file that a button gives in a run of SECONDS that is looked at in the middle. window: s, of the
    plots; plots, lines: of the figure; part: of the run."""
    loop, _ = simulate(edited(load("ur5-hybrid"), "simulation.duration", SECONDS))
    snapshot = snapshot_of(loop)
    desk = MagicMock()
    desk.viewing = Viewing()
    desk.snapshot = lambda: replace(snapshot, t=0.5)
    given: dict[str, str] = {}

    def named(button: str, form: str, *, window: float = 0.2, plots: str = "all plots", lines: str = "", part=SHOWN):
        widgets: dict[str, Any] = {}
        desk.gui = SimpleNamespace(
            **dict.fromkeys(
                ("add_dropdown", "add_text", "add_checkbox", "add_button_group", "add_upload_button"),
                lambda label, *_, **__: widgets.setdefault(label, MagicMock(value="")),
            )
        )
        desk.viewing.window = window
        panel = ExportPanel(cast(Desk, desk))
        panel._delivery = cast(Any, SimpleNamespace(give=lambda _, __, name, ___, **____: given.update(name=name)))
        for label, value in (("Figure of", plots), ("Lines", lines), ("Part of the run", part)):
            widgets[label].value = value
        widgets["Width"].value, widgets["Text size"].value = "as the plots need", "7 pt"
        callback = {"Figure": panel._on_figure, "Data": panel._on_data, "3-D playback": panel._on_playback,
                    "3-D picture": panel._on_picture, "Scenario": panel._on_scenario}[button]  # fmt: skip
        callback(cast(viser.GuiEvent, SimpleNamespace(target=SimpleNamespace(value=form), client=MagicMock())))
        return given["name"]

    return named


def test_a_part_of_the_run_is_named_by_its_instants(name_of: Callable[..., str]) -> None:
    for button, form, ending in (("Data", "CSV", "csv"), ("Data", "NPZ", "npz"), ("3-D playback", "HTML", "html")):
        assert name_of(button, form) == f"vsmrc-ur5-hybrid-0.30-0.50s.{ending}"
        assert name_of(button, form, window=8.0) == f"vsmrc-ur5-hybrid-0.50s.{ending}"
        assert name_of(button, form, part=WHOLE) == f"vsmrc-ur5-hybrid-{SECONDS:.2f}s.{ending}"
    assert name_of("Scenario", "TOML") == "vsmrc-ur5-hybrid-0.50s.toml"


def test_what_is_drawn_differently_has_another_name(name_of: Callable[..., str]) -> None:
    names = [
        name_of("Figure", "PNG"),
        name_of("Figure", "PNG", plots="Torque"),
        name_of("Figure", "PNG", plots="Torque", lines="τ₁, τ₂"),
        name_of("3-D picture", "1×"),
        name_of("3-D picture", "2×"),
    ]
    assert names[:3] == [
        "vsmrc-ur5-hybrid-0.30-0.50s.png",
        "vsmrc-ur5-hybrid-Torque-0.30-0.50s.png",
        "vsmrc-ur5-hybrid-Torque-tau_1-tau_2-0.30-0.50s.png",
    ]
    assert len(set(names)) == len(names)
