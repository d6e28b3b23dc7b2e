"""Robustness map on the page: a figure over one or two fields and over true arms, computed beside the loop; a tile
opens its run."""

from __future__ import annotations

from dataclasses import replace
from html import escape

import msgspec
import viser

from app.dashboard.transport.callback_errors import guarded
from app.dashboard.widgets.families.background_work import BackgroundWork, earlier_html, task_of, with_least_duration
from app.dashboard.widgets.families.map_tiles import FIELD, Naming, map_html
from app.dashboard.widgets.families.swept_fields import (
    FIELDS,
    NONE,
    FieldChoice,
    field_of_row,
    number_of,
    prepared,
    require_arms,
    require_ends,
)
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.fields.field_binding import NumberRow
from app.export.export_jobs import MadeJob, file_name
from app.export.formats import FIGURE_FORMATS
from app.scenario.departures import DRAWN
from app.scenario.errors import ScenarioError
from app.scenario.number_text import rounded
from app.scenario.schema import Scenario
from app.scenario.units import Units
from app.session.commands import Perform, Pin
from app.session.snapshot import Snapshot
from app.storage.joint_kinds import units_of
from app.storage.recording_files import ProgressCallback
from app.sweep import charts
from app.sweep.background import BackgroundSweep
from app.sweep.plan import Sweep, SweepPlan
from app.sweep.points import Points, SweepView, points_of
from app.sweep.run_metrics import COLUMNS, RunMetrics, columns_of
from app.sweep.titles import unit_of

SIZES = {"5": 5, "9": 9, "13": 13}
ARMS = {"the scenario's own": 0, "4 of the declared set": 4, "8 of the declared set": 8, "16 of the declared set": 16}
METRICS = {  # columns by title, and by which factor they are shown
    "largest force error at the end": ("force_error", 1.0),
    "largest moment error of a flat tool at the end": ("moment_error", 1.0),
    "largest path error at the end": ("motion_error", 1e3),
    "largest angle error at the end": ("angle_error", 1e3),
    "torque variation": ("torque_variation", 1.0),
    "residual of (8)": ("residual", 1.0),
    "settling time": ("settling_time", 1.0),
    "share of the run that is promised": ("promised_share", 100.0),
}
FOLDER = "sweep folder"


class RobustnessMap(BackgroundWork[BackgroundSweep]):
    """Robustness map with its controls, in the current container.

    The map's runs and those of the page's loop are equal to the last bit, so that a tile opens the run that it shows.
    """

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk, "Compute the map", "Cancel")
        self._opened: Scenario | None = None  # by a tile
        gui = desk.gui
        gui.add_html(
            '<div class="vs-note">One metric for many settings and for true arms drawn from the declared '
            f"set, computed beside the loop by {desk.background_jobs.allowance}. A click on a tile plays the run of "
            "its worst arm and pauses at its end; the present run is pinned (tab Runs).</div>"
        )
        self._across = FieldChoice(desk, "Across", FIELDS, "stiffness of the surface", optional=False)
        self._up = FieldChoice(desk, "Up", FIELDS, "mass of the true links, factor", optional=True)
        self._fields = {field.path: field for field in FIELDS}
        self._size = gui.add_dropdown("Steps of each", tuple(SIZES), initial_value="9")
        self._arms = gui.add_dropdown(
            "True arms",
            tuple(ARMS),
            hint="The same arms at every tile; across declared bounds, the same shares of them.",
        )
        self._metric = gui.add_dropdown("Metric", tuple(METRICS), hint="At the end: over the last fifth of each run.")
        self._add_length()
        self._within = gui.add_text(
            "Limit", "", hint="Shows the share of arms that keep this limit; empty: the worst arm."
        )
        self._add_button()
        self._files = gui.add_button_group(
            "This map",
            (*FIGURE_FORMATS, FOLDER),
            visible=False,
            hint="As a figure, or with all its runs for `vsmrc sweep`.",
        )
        self._add_mark(FIELD)
        self._files.on_click(guarded(self._on_file, desk.complain))

    def sweep(self, row: NumberRow) -> None:
        """Choose the field of this row as the only one, around its present value. Raises ScenarioError."""
        field = field_of_row(row, self._desk.snapshot())
        self._fields[field.path] = field
        self._across.choose(field)
        self._up.leave()

    def _begin(self, snapshot: Snapshot) -> BackgroundSweep:
        request = self._request(snapshot)
        return self._desk.background_jobs.begin(
            lambda allowance: BackgroundSweep(request, allowance.workers, allowance.at_once), SweepPlan(request).count
        )

    def _on_file(self, event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
        """Callback of the buttons for files; viser calls it in a thread of its pool, which may wait."""
        sweep, chosen = self._work, event.target.value
        if sweep is None or not sweep.rows:
            return
        request, rows, view, jobs = sweep.plan.sweep, list(sweep.rows), self._view, self._desk.export_jobs
        if chosen == FOLDER:
            from app.sweep import folder  # here: pyarrow is large, and few sessions need it

            job, extension = MadeJob(folder.zipped, (request, rows)), "zip"
        else:
            form = FIGURE_FORMATS[chosen]
            job, extension = MadeJob(charts.chart, (request, columns_of(rows), view, form)), form
        name = file_name(f"{request.scenario.name}-map", request.length, extension, shown_by(request, view))

        def make(on_progress: ProgressCallback) -> bytes:
            return jobs.made(job, on_progress)

        self._delivery.give(event, "Map", name, make)

    def _request(self, snapshot: Snapshot) -> Sweep:
        """Sweep of the present choices. Raises ScenarioError."""
        seconds = self._length()
        if self._within.value.strip():
            number_of("Limit", self._within.value)
        sides = [side for side in (self._across, self._up) if side.field is not None]
        fields = [side.field for side in sides if side.field is not None]
        if len({field.path for field in fields}) < len(fields):
            raise ScenarioError(f"Up: {fields[0].name}, as across; allowed: another field, or {NONE}")
        arms = ARMS[self._arms.value]
        for field in fields:
            if arms and field.path.startswith("truth.") and field.path.split(".")[1] in DRAWN:
                raise ScenarioError(f"{field.name}: it is drawn for each true arm; allowed: the scenario's own arm")
        scenario, count = prepared(snapshot, fields), SIZES[self._size.value]
        vary = tuple(side.axis(scenario, count) for side in sides)
        for field, axis in zip(fields, vary, strict=True):
            require_ends(scenario, field.name, axis)
        request = Sweep(with_least_duration(scenario, seconds), vary, draw=arms, until=seconds, engine="pinocchio")
        require_arms(request, f"True arms: {self._arms.value}", "the scenario's own")
        self._fields |= {field.path: field for field in fields}
        return request

    def _choose(self, work: BackgroundSweep, number: str, client: int) -> None:
        del client
        rows = [row for row in work.rows if number.isdecimal() and row["point"] == int(number)]
        if not rows:
            return
        if self._desk.lock.refuses("the run of a tile"):
            return
        metric, plan = self._view.metric, work.plan
        worst = max(rows, key=lambda row: badness(row, metric))
        try:
            scenario = plan.scenario(plan.row(worst["row"]))
        except ScenarioError as error:
            self._desk.complain(str(error))
            return
        named = msgspec.structs.replace(scenario, name=plan.sweep.scenario.name)
        snapshot, end = self._desk.snapshot(), plan.sweep.length
        if snapshot.scenario != self._opened and len(snapshot.recording):
            self._desk.post(Pin(may_be_pinned=True))
        self._opened = named
        self._desk.post(Perform(named, (), end))

    @property
    def _limit(self) -> float | str | None:
        """The limit as it is typed, or why it is none; None where no limit is typed."""
        limit = self._within.value.strip()
        try:
            return number_of("Limit", limit) if limit else None
        except ScenarioError as error:
            return str(error)

    @property
    def _view(self) -> SweepView:
        name, factor = METRICS[self._metric.value]
        limit = self._limit
        return SweepView(name, within=limit / factor if isinstance(limit, float) else None)

    def _unit(self, units: Units) -> str:
        """Unit in which the figure is shown."""
        name, factor = METRICS[self._metric.value]
        unit = COLUMNS[name].unit_in(units)
        thousandth = " and ".join(f"m{each}" for each in unit.split(" and "))
        return {1.0: unit, 1e3: thousandth, 100.0: "%"}[factor]

    def _naming(self, units: Units) -> Naming:
        _, factor = METRICS[self._metric.value]
        unit = self._unit(units)
        axes = {path: (field.name, unit_of(path, units)) for path, field in self._fields.items()}
        within = self._view.within
        limit = "" if within is None else f"{rounded(factor * within)} {unit}"
        return Naming(self._metric.value, unit, factor, limit, axes)

    def _points(self, sweep: BackgroundSweep) -> Points | None:
        rows = sweep.rows
        return points_of(sweep.plan.sweep, columns_of(rows), self._view) if rows else None

    def show(self, snapshot: Snapshot) -> None:
        """Show the map so far, and the units of the ranges and the limit."""
        for side, other in ((self._across, self._up), (self._up, self._across)):
            side.avoid(snapshot.scenario, other.field)
            side.show(snapshot.system.units)
        units = snapshot.system.units if self._work is None else units_of(self._work.plan.sweep.scenario)
        self._within.label = f"Limit [{self._unit(units)}]"
        super().show(snapshot)

    def _drawn(self, work: BackgroundSweep, snapshot: Snapshot) -> str:
        if self._files.visible != bool(work.rows):
            self._files.visible = bool(work.rows)
        sweep, present = work.plan.sweep, {}
        problem = self._limit if isinstance(self._limit, str) else ""
        note = f'<div class="vs-note">{escape(problem)}. The map shows the worst arm.</div>' if problem else ""
        if task_of(sweep.scenario) == task_of(snapshot.scenario):
            present = {axis.path: self._fields[axis.path].value(snapshot) for axis in sweep.vary}
        else:
            note += earlier_html("The map")
        return note + map_html(work, self._points(work), self._naming(units_of(sweep.scenario)), present)


def shown_by(sweep: Sweep, view: SweepView) -> str:
    """Part of the names of a map's files: what it shows."""
    arms = f"-{sweep.draw}-arms" if sweep.draw else ""
    return replace(view, over=tuple(axis.path for axis in sweep.vary)).name + arms


def badness(row: RunMetrics, metric: str) -> tuple[bool, float]:
    """Order of the runs of a point, the worst last: those whose end leaves them without the metric, then by it."""
    column, value = COLUMNS[metric], row.get(metric)
    ended = bool(row.get("stopped")) and (value is None or not column.also_stopped)
    return ended, float(column.badness(value))
