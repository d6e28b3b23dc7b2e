"""Map of a figure over two fields and over true arms, filled in while the loop runs; a tile opens its run."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
import viser

from app.dashboard.theme.style import MARKS
from app.dashboard.transport.callback_errors import guarded
from app.dashboard.widgets.controls import Desk
from app.dashboard.widgets.map_tiles import Naming, map_html
from app.scenario.schema import Scenario, ScenarioError, field_info
from app.session.commands import Load, Play, Reset
from app.session.snapshot import Snapshot
from app.sweep.background import BackgroundSweep
from app.sweep.figures_of_run import COLUMNS, Figures
from app.sweep.points import Points, View, points_of
from app.sweep.question import Axis, Sweep, fingerprint, to_toml

EVERY = 0.7  # s, between two pictures
WORKERS = max(1, (os.cpu_count() or 1) - 1)
SIZES = {"5 × 5": 5, "9 × 9": 9, "13 × 13": 13}
ARMS = {"the scenario's own": 0, "4 of the declared set": 4, "8 of the declared set": 8, "16 of the declared set": 16}


@dataclass(frozen=True)
class Field:
    """Field that a map can have across or up: where it is, and the range at first."""

    path: str
    low: float
    high: float
    logarithmic: bool = False


FIELDS = {
    "stiffness of the surface": Field("contact.K_e", 1e3, 1e5, logarithmic=True),
    "mass of the true links, factor": Field("truth.link_scaling", 0.7, 1.4),
    "payload": Field("truth.payload_mass", 0.0, 2.0),
    "friction in the joints": Field("truth.coulomb", 0.0, 4.0),
    "friction of the surface": Field("contact.friction_coulomb", 0.0, 0.6),
    "believed stiffness": Field("controller.K_e_hat", 1e3, 1e5, logarithmic=True),
    "boundary layer": Field("controller.layer", 1e-3, 0.05, logarithmic=True),
    "control period": Field("controller.period", 5e-4, 5e-3, logarithmic=True),
    "reaching gain K_s": Field("controller.K_s", 20.0, 500.0, logarithmic=True),
    "sliding gain F_1": Field("controller.F_1", 3.0, 40.0, logarithmic=True),
    "noise of the sensor": Field("sensor.noise", 0.0, 1.0),
    "delay of the sensor": Field("sensor.delay", 0.0, 0.02),
    "desired force": Field("force.value", 5.0, 60.0),
    "time of one turn": Field("motion.period", 1.0, 8.0),
}
METRICS = {
    "force error at the end": ("force_error", 1.0, "N"),
    "path error at the end": ("motion_error", 1e3, "mm"),
    "variation of the torques": ("torque_variation", 1.0, "N·m/s"),
    "residual of (8)": ("residual", 1.0, "N"),
    "share of the run that is promised": ("promised_share", 100.0, "%"),
}


class RobustnessMap:
    """Controls of the map and its picture, in the current container."""

    def __init__(self, desk: Desk) -> None:
        self._desk, gui = desk, desk.gui
        self._sweep: BackgroundSweep | None = None
        self._shown: tuple[int, bool] | None = None
        self._due = 0.0
        with gui.add_folder("Robustness map", expand_by_default=False):
            gui.add_html(
                '<div class="vs-note">One figure for many settings, and for true arms drawn within what is declared. '
                f"It is computed beside the loop, by {WORKERS} of this machine's {os.cpu_count() or 1} cores; a click "
                "on a tile opens that run, of the worst arm.</div>"
            )
            self._across = _Side(desk, "Across", "stiffness of the surface")
            self._up = _Side(desk, "Up", "mass of the true links, factor")
            self._size = gui.add_dropdown("Tiles", tuple(SIZES), initial_value="9 × 9")
            self._arms = gui.add_dropdown("True arms", tuple(ARMS), hint="The same arms at every tile.")
            self._metric = gui.add_dropdown("Figure", tuple(METRICS), hint="Over the last fifth of each run.")
            self._seconds = gui.add_text("each run [s]", "2", hint="0.2 to 10 s.")
            self._within = gui.add_text("limit", "", hint="Share of the arms that keep it; empty: the worst arm.")
            self._button = gui.add_button("Compute the map", color="green")
            self._html = gui.add_html("")
            self._file = gui.add_button("This sweep as a file", color="gray", visible=False, hint="For `vsmrc sweep`.")
            gui.add_html('<i class="vs-tile-field"></i>')
            self._tile = gui.add_text("", "")
        for text in (self._seconds, self._within):
            text.on_update(_unmarked)
        self._button.on_click(self._on_button)
        self._file.on_click(guarded(self._on_file, desk.complain))
        self._tile.on_update(self._on_tile)

    async def _on_button(self, _: object) -> None:
        if self._sweep is not None and self._sweep.going:
            self._sweep.cancel()
            return
        try:
            self._sweep = BackgroundSweep(self._asked(self._desk.snapshot().scenario), WORKERS)
        except ScenarioError as error:
            self._desk.complain(str(error))

    # synchronous on purpose: it reads the whole program

    def _on_file(self, event: viser.GuiEvent) -> None:
        if self._sweep is not None and event.client is not None:
            asked = msgspec.structs.replace(self._sweep.question.sweep, program=fingerprint())
            event.client.send_file_download("sweep.toml", to_toml(asked).encode(), save_immediately=True)

    def _asked(self, scenario: Scenario) -> Sweep:
        """Sweep of the present choices. Raises ScenarioError."""
        seconds = _number("each run", self._seconds.value)
        if not 0.2 <= seconds <= 10.0:
            raise ScenarioError(f"each run: {seconds:g} s; allowed: 0.2 to 10 s")
        if self._within.value.strip("".join(MARKS)).strip():
            _number("limit", self._within.value)
        count = SIZES[self._size.value]
        vary = (self._across.axis(scenario, count), self._up.axis(scenario, count))
        simulation = msgspec.structs.replace(scenario.simulation, duration=seconds)
        scenario = msgspec.structs.replace(scenario, simulation=simulation)
        return Sweep(scenario, vary, draw=ARMS[self._arms.value])

    async def _on_tile(self, event: viser.GuiEvent) -> None:
        text = self._tile.value.partition(" ")[0]
        if event.client is None or self._sweep is None or not text.isdecimal():
            return
        rows = [row for row in self._sweep.rows if row["point"] == int(text)]
        if not rows:
            return
        metric, question = self._view.metric, self._sweep.question
        worst = max(rows, key=lambda row: (bool(row.get("stopped")), row.get(metric) or -math.inf))
        before = self._desk.snapshot().scenario
        try:
            scenario = question.scenario(question.row(worst["row"]))
        except ScenarioError as error:
            self._desk.complain(str(error))
            return
        self._desk.post(Load(msgspec.structs.replace(scenario, name=before.name, simulation=before.simulation)))
        self._desk.post(Reset())
        self._desk.post(Play())

    @property
    def _view(self) -> View:
        name, factor, _ = METRICS[self._metric.value]
        limit = self._within.value.strip("".join(MARKS)).strip()
        try:
            return View(name, within=_number("limit", limit) / factor if limit else None)
        except ScenarioError:
            return View(name)

    @property
    def _naming(self) -> Naming:
        _, factor, unit = METRICS[self._metric.value]
        axes = {field.path: (name, _unit(field.path)) for name, field in FIELDS.items()}
        return Naming(self._metric.value, unit, factor, self._view.within is not None, axes)

    def _points(self, sweep: BackgroundSweep) -> Points | None:
        rows = sweep.rows
        return points_of(sweep.question.sweep, _columns(rows), self._view) if rows else None

    def show(self, snapshot: Snapshot) -> None:
        """Show what has come in."""
        self._across.show()
        self._up.show()
        sweep, now = self._sweep, time.monotonic()
        if sweep is None or now < self._due:
            return
        self._due = now + EVERY
        label = "Cancel" if sweep.going else "Compute the map"
        if self._button.label != label:
            self._button.label, self._button.color = label, "gray" if sweep.going else "green"
        if not self._file.visible:
            self._file.visible = True
        content = map_html(sweep, self._points(sweep), self._naming, snapshot.scenario)
        if self._html.content != content:
            self._html.content = content


class _Side:
    """Field and range of one side of the map."""

    def __init__(self, desk: Desk, label: str, first: str) -> None:
        self._desk = desk
        self._field = desk.gui.add_dropdown(label, tuple(FIELDS), initial_value=first)
        self._range = desk.gui.add_text("from, to", _range(FIELDS[first]), hint="Two numbers, in the unit below.")
        self._of = first
        self._field.on_update(self._on_field)
        self._range.on_update(_unmarked)

    async def _on_field(self, _: object) -> None:
        if self._field.value != self._of:
            self._of = self._field.value
            self._range.value = _range(FIELDS[self._of])

    def show(self) -> None:
        unit = _unit(FIELDS[self._field.value].path)
        label = f"from, to [{unit}]" if unit else "from, to"
        if self._range.label != label:
            self._range.label = label

    def axis(self, scenario: Scenario, count: int) -> Axis:
        """Axis with so many values. Raises ScenarioError where the scenario has no such number, or for no range."""
        field, name = FIELDS[self._field.value], self._field.value
        value = scenario
        for part in field.path.split("."):
            value = getattr(value, part, None)
        if value is None:
            raise ScenarioError(f"{name}: this scenario has none; allowed: another field")
        parts = self._range.value.strip("".join(MARKS)).split(",")
        if len(parts) != 2:
            raise ScenarioError(f"{name}: {self._range.value.strip(''.join(MARKS))!r:.60}; allowed: two numbers")
        low, high = (_number(name, part) for part in parts)
        if not low < high:
            raise ScenarioError(f"{name}: {low:g} to {high:g}; allowed: low before high")
        logarithmic = field.logarithmic and low > 0.0
        values = np.geomspace(low, high, count) if logarithmic else np.linspace(low, high, count)
        return Axis(field.path, tuple(float(f"{value:.6g}") for value in values))


async def _unmarked(event: viser.GuiEvent) -> None:
    if event.client is not None and event.target.value.endswith(MARKS):
        event.target.value = event.target.value.rstrip("".join(MARKS))


def _number(name: str, text: str) -> float:
    try:
        value = float(text.strip("".join(MARKS)).strip().replace("−", "-"))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ScenarioError(f"{name}: {text.strip(''.join(MARKS))!r:.40}; allowed: a number")
    return value


def _range(field: Field) -> str:
    return f"{field.low:g}, {field.high:g}"


def _unit(path: str) -> str:
    unit = field_info(path).unit
    return "" if unit == "1" else unit


def _columns(rows: Sequence[Figures]) -> dict[str, np.ndarray]:
    """Columns of rows, NaN or None where one is missing."""
    names = {name for row in rows for name in row} | set(COLUMNS)
    words = {name for name, column in COLUMNS.items() if column.word}
    columns = {}
    for name in names:
        values = [row.get(name) for row in rows]
        columns[name] = (
            np.array(values, dtype=object)
            if name in words
            else np.array([np.nan if value is None else value for value in values])
        )
    return columns
