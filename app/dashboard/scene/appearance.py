"""Dark or light theme: state of the page, not of the scenario, and the same for everybody who looks at this
dashboard."""

from __future__ import annotations

import viser

from app.dashboard.scene.view import SceneView
from app.dashboard.theme.colors import BRAND, Theme


class Appearance:
    """The theme, and the command that changes it; text and plots follow by the style sheet and the script."""

    def __init__(self, gui: viser.GuiApi, scene: SceneView, theme: Theme) -> None:
        self._gui, self._scene = gui, scene
        self._choose(theme)
        gui.add_command("Theme: dark or light", hotkey="T").on_trigger(self._toggle)

    async def _toggle(self, _: viser.CommandEvent) -> None:
        self._choose("light" if self._theme == "dark" else "dark")

    def _choose(self, theme: Theme) -> None:
        self._theme: Theme = theme
        self._gui.configure_theme(
            dark_mode=theme == "dark", show_logo=False, show_share_button=False, brand_color=BRAND[theme]
        )
        self._scene.set_theme(theme)
