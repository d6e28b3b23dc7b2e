"""Offer to continue the last session, that of an earlier server: its buttons are on every page until one visitor has
answered."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from html import escape

import viser

from app.dashboard.transport.callback_errors import Complain, guarded
from app.dashboard.widgets.fields.edit_lock import EditLock
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.autosave import Autosave, Offer, StateFolder
from app.session.commands import Continue
from app.session.timeline import Pinned

_GO_ON, _NOT = "Continue where you left off", "Dismiss"


@dataclass(frozen=True)
class LastSession:
    """Last session, to be offered.
    offer: None where the session cannot be read.
    problem: reason why it cannot be read, "" where it can.
    take_up: returns its pinned runs and a sentence about those that cannot be read, or raises ScenarioError.
    refuse: forgets the session."""

    offer: Offer | None
    problem: str
    take_up: Callable[[Offer], tuple[tuple[Pinned, ...], str]]
    refuse: Callable[[], None]


def remark(problem: str) -> LastSession:
    """Remark in place of an offer: a sentence that is shown until somebody dismisses it."""
    return LastSession(None, problem, lambda _: ((), ""), lambda: None)


def left_by(folder: StateFolder, autosave: Autosave, chosen: Scenario) -> LastSession | None:
    """Last session of a folder, None where there is none, or where it is that of the scenario that runs already."""
    offer = folder.offer()
    if offer is not None and offer.scenario == chosen and not offer.runs:
        return None
    if offer is None and not folder.problem:
        return None
    return LastSession(offer, folder.problem, autosave.take_up, autosave.refuse_offer)


def add_last_session(gui: viser.GuiApi, session: LastSession, order: float, lock: EditLock, complain: Complain) -> None:
    """Add the offer to the current container, until it is answered. order: place among the other widgets."""
    folder = gui.add_folder("Last session", order=order)
    with folder:
        text = gui.add_html(_note(session.problem if session.offer is None else _offer_text(session.offer)))
        buttons = [gui.add_button(_GO_ON)] if session.offer is not None else []
        buttons.append(gui.add_button(_NOT, color="gray"))

    answering = threading.Lock()  # the second of two clicks is ignored, also where one continues and one dismisses

    # synchronous on purpose, unlike callbacks that post commands: reading takes seconds, in a thread of viser's pool
    def on_continue(event: viser.GuiEvent) -> None:
        offer = session.offer
        if offer is None or event.client is None or lock.refuses("the last session"):
            return
        if not answering.acquire(blocking=False):
            return
        for button in buttons:
            button.visible = False
        text.content = _note("reading …")

        def offer_again() -> None:
            text.content = _note(_offer_text(offer))
            for button in buttons:
                button.visible = True
            answering.release()

        try:
            runs, problem = session.take_up(offer)
        except Exception as error:
            offer_again()
            if not isinstance(error, ScenarioError):
                raise
            complain(f"the last session cannot be continued now: {error}")
            return
        if lock.post(Continue(offer.scenario, runs)) is None:  # a lesson's goal has begun meanwhile
            offer_again()
            return
        if problem:
            complain(problem)
        folder.visible = False

    def on_dismiss(event: viser.GuiEvent) -> None:
        if event.client is not None and answering.acquire(blocking=False):
            folder.visible = False
            session.refuse()

    if session.offer is not None:
        buttons[0].on_click(guarded(on_continue, complain))
    buttons[-1].on_click(guarded(on_dismiss, complain))


def _offer_text(offer: Offer) -> str:
    when = datetime.fromtimestamp(offer.saved).strftime("%d %b %Y, %H:%M")
    runs = {0: "", 1: " with a pinned run"}.get(len(offer.runs), f" with {len(offer.runs)} pinned runs")
    return f"{offer.scenario.title or offer.scenario.name}{runs}, saved {when}"


def _note(text: str) -> str:
    return f'<div class="vs-note">{escape(text)}</div>'
