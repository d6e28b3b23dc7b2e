"""Guided minute: a folder above the tabs that leads through the five modes, a click for each."""

from __future__ import annotations

from dataclasses import dataclass

import viser

from app.dashboard.widgets.fields.controls import Desk
from app.scenario.data import edited, load
from app.scenario.schema import Scenario
from app.session.commands import Load, Play
from app.session.snapshot import Snapshot
from controllers.modes import MODES


@dataclass(frozen=True)
class GuidedStep:
    """Step of the guided minute. look: what the user should look at, HTML."""

    scenario: Scenario
    look: str

    @property
    def title(self) -> str:
        return MODES[self.scenario.mode].label


def steps() -> tuple[GuidedStep, ...]:
    """Steps of the guided minute, one for each mode."""
    heavy = edited(load("ur5-heavy"), "controller.law", "vsmrc")
    return (
        GuidedStep(
            load("ur5-motion"),
            "The tool draws a circle in free space. The arm is 15 % heavier than the controller believes, and the "
            "<b>tracking error</b> on the left settles below 0.02 mm all the same. <kbd>B</kbd> pushes the tool, and "
            "nothing happens: this target model (26) does not react to a force.",
        ),
        GuidedStep(
            load("ur5-impedance"),
            "Now the arm is a mass, a damper and a spring. It meets the plane and stops where spring and plane "
            "balance: this error stays, because no force is desired. Every few seconds it is pushed with 30 N, "
            "and the spring of 2000 N/m gives way by 15 mm.",
        ),
        GuidedStep(
            heavy,
            "Force across the surface, motion along it: the tool presses with 20 N and draws its circle, pushed or "
            "not. <kbd>L</kbd> swaps the robust law for computed torque, and the <b>force</b> is wrong by up to 9 N; "
            "<kbd>L</kbd> again brings it back.",
        ),
        GuidedStep(
            load("ur5-hybrid-impedance"),
            "The force is held at 20 N as before, but along the surface the arm is a spring: a push of 30 N moves it "
            "away by 7 mm and it comes back, while the <b>force</b> stays where it is.",
        ),
        GuidedStep(
            load("ur5-constrained"),
            "The plane is rigid now. The force is whatever keeps the tool on it, a Lagrange multiplier λ instead of a "
            "spring's force. The law holds it at 20 N without measuring any depth.",
        ),
    )


class GuidedMinute:
    """Folder of the guided minute, which key G opens and closes. All pages of a session share it, as they share the
    run that it changes."""

    def __init__(self, desk: Desk) -> None:
        self._desk, self._steps, self._at = desk, steps(), 0
        self._begun = 0  # number of the command that loads the step's scenario
        gui = desk.gui
        gui.add_command("A guided minute: the five modes", hotkey="G").on_trigger(self._toggle)
        self._folder = gui.add_folder("A guided minute", visible=False)
        with self._folder:
            self._text = gui.add_html("")
            self._next = gui.add_button("")
            self._close = gui.add_button("Close", color="gray", hint="Key: G")
        self._next.on_click(self._go_on)
        self._close.on_click(self._toggle)

    def show(self, snapshot: Snapshot) -> None:
        """Close the folder when its scenario has been left for another one, or for another mode."""
        asked, running = self._steps[self._at].scenario, snapshot.scenario
        left = (running.name, running.mode) != (asked.name, asked.mode)
        if self._folder.visible and left and snapshot.executed >= self._begun:
            self._folder.visible = False

    async def _toggle(self, _: object) -> None:
        if self._folder.visible:
            self._folder.visible = False
        else:
            self._enter(0)

    async def _go_on(self, _: viser.GuiEvent) -> None:
        if self._at + 1 < len(self._steps):
            self._enter(self._at + 1)
        else:
            self._folder.visible = False

    def _enter(self, at: int) -> None:
        """Begin a step and show it; nothing where the page refuses it, as while a lesson's goal is open."""
        step = self._steps[at]
        begun = self._desk.post(Load(step.scenario))
        if begun is None:
            return
        self._desk.post(Play())
        self._at, self._begun, self._folder.visible = at, begun, True
        self._text.content = (
            f'<div class="vs-minute"><b>{step.title}</b> <span class="vs-dim">{at + 1} of {len(self._steps)}</span>'
            f"<p>{step.look}</p></div>"
        )
        following = self._steps[at + 1 :]
        self._next.label = f"Next: {following[0].title}" if following else "Done: go on by yourself"
