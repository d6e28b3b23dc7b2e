"""Impedance on the page: its map, the points that a simulated push measures beside the loop, and both as files."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass

import viser

from app.dashboard.transport.callback_errors import Fault, guarded
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.page.file_delivery import FileDelivery
from app.dashboard.widgets.target_model.impedance_map import impedance_html
from app.export.export_jobs import ExportError, FigureJob, MadeJob, file_name
from app.export.formats import FIGURE_FORMATS
from app.export.response_files import figure_of, force_table_of, table_of
from app.scenario.caption import title_of
from app.scenario.data import shipped
from app.scenario.schema import Scenario
from app.session import push_measurement
from app.session.headless_run import engine_ready
from app.session.push_measurement import Measured, chirp_for, decoded, encoded, not_linear
from app.session.snapshot import Snapshot
from app.simulation.sampled_loop.push_response import PushResponse
from app.simulation.sampled_loop.sampled_stability import RespondingLoop
from app.storage.recording_files import ProgressCallback

_SIZES = f"{push_measurement.NEWTONS:g} N, or {push_measurement.NEWTON_METRES:g} N·m,"
RESPONSE, FORCE_LOOP = "CSV", "force loop"


@dataclass(frozen=True)
class _Measurement:
    """Measurement of the impedance by a push.
    scenario, run: in which the push began.
    t: instant at which the push began, s.
    loop: sampled loop at that instant, with the predicted response.
    points: measured.
    beside: properties of the run that the prediction leaves out."""

    scenario: Scenario
    run: int
    t: float
    loop: RespondingLoop
    points: Sequence[Measured]
    beside: tuple[str, ...]

    def still_of(self, snapshot: Snapshot) -> bool:
        """Whether it is of the run and the scenario of a snapshot."""
        return (self.scenario, self.run) == (snapshot.scenario, snapshot.run)

    def description(self, response: PushResponse) -> str:
        """Words on the measured points, for the text below the map. response: predicted."""
        sentence = push_measurement.deviation_sentence(self.points, response, self.beside)
        return f"dots: a chirp of {_SIZES} from t = {self.t:.2f} s on; {sentence}"


class ImpedanceView:
    """Map of the impedance with its buttons, in the current container."""

    def __init__(self, desk: Desk) -> None:
        self._desk, gui = desk, desk.gui
        self._html = gui.add_html("")
        hint = (
            f"Pushes copies of this run with {_SIZES}, along and about each axis, at frequencies that rise from low to "
            "high."
        )
        self._button = gui.add_button("Measure with a push", color="gray", visible=False, hint=hint)
        self._files = gui.add_button_group(
            "This response",
            (*FIGURE_FORMATS, RESPONSE, FORCE_LOOP),
            visible=False,
            hint="With measured points, if any.",
        )
        self._busy, self._delivery = threading.Lock(), FileDelivery()
        self._measurement: _Measurement | None = None
        self._drawn: tuple[PushResponse | None, _Measurement | None] = (None, None)
        self._button.on_click(guarded(self._on_button, desk.complain))
        self._files.on_click(guarded(self._on_file, desk.complain))

    def _on_button(self, _: object) -> None:
        """Callback of the button that measures; viser calls it in a thread of its pool, which may wait."""
        snapshot = self._desk.snapshot()
        loop, state = snapshot.sampled, snapshot.state
        if loop.response is None or not self._busy.acquire(blocking=False):
            return
        try:
            job = MadeJob(encoded, (state, loop.response.axes, chirp_for(state), engine_ready()))
            points = decoded(self._desk.export_jobs.made(job, lambda _: None))
            measured = _Measurement(snapshot.scenario, snapshot.run, state.t, loop, points, not_linear(state))
            now = self._desk.snapshot()
            if (now.run, now.latest.scenario) != (snapshot.run, snapshot.latest.scenario):
                self._desk.complain(f"the push measured the run at t = {state.t:.2f} s, which has been changed since")
            self._measurement = measured
        except (ExportError, OSError) as error:
            self._desk.complain(Fault(f"the impedance could not be measured: {error}"))
        finally:
            self._busy.release()

    def _on_file(self, event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
        """Callback of the buttons for files; viser calls it in a thread of its pool, which may wait."""
        snapshot, chosen = self._desk.snapshot(), event.target.value
        measurement = self._of(snapshot)
        loop, t = (snapshot.sampled, snapshot.t) if measurement is None else (measurement.loop, measurement.t)
        points = () if measurement is None else measurement.points
        if loop.response is None:
            return
        title = title_of(snapshot.scenario, shipped().get(snapshot.scenario.name)).text
        figure = figure_of(loop, loop.response, points, f"{title}, at t = {t:.3g} s.")
        what, table = "response", table_of(loop.response, points)
        if chosen == FORCE_LOOP:
            if loop.force_loop is None:
                self._desk.complain("force loop: the law reads no sampled force of a contact; allowed: CSV")
                return
            what, table = "force-loop", force_table_of(loop.force_loop)
        name = file_name(f"{snapshot.scenario.name}-{what}", t, FIGURE_FORMATS.get(chosen, "csv"))

        def make(on_progress: ProgressCallback) -> bytes:
            if chosen in FIGURE_FORMATS:
                return self._desk.export_jobs.made(FigureJob(figure, FIGURE_FORMATS[chosen]), on_progress)
            return table.encode()

        self._delivery.give(event, "Response", name, make)

    def _of(self, snapshot: Snapshot) -> _Measurement | None:
        """The measurement, None once the scenario has been changed or another run has begun."""
        found = self._measurement
        return found if found is not None and found.still_of(snapshot) else None

    def show(self, snapshot: Snapshot) -> None:
        measurement = self._of(snapshot)
        response = snapshot.sampled.response if measurement is None else measurement.loop.response
        for handle in (self._button, self._files):
            if handle.visible != (response is not None):
                handle.visible = response is not None
        self._button.label = "Measuring …" if self._busy.locked() else "Measure with a push"
        if self._drawn[0] is response and self._drawn[1] is measurement:
            return
        self._drawn = response, measurement
        if response is None:
            self._html.content = ""
        elif measurement is None:
            self._html.content = impedance_html(response)
        else:
            self._html.content = impedance_html(response, measurement.points, measurement.description(response))
