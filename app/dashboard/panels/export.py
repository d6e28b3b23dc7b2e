"""Export panel: files made from a run, one button each, and the upload of a scenario."""

from __future__ import annotations

import asyncio
import io
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import viser
from PIL import Image

from app.dashboard.plots.charts import Setup
from app.dashboard.plots.paper_figures import BESIDE_PLAYBACK, figure_name, figure_of, plots_of, with_series
from app.dashboard.plots.pinned_runs import PinnedChart
from app.dashboard.plots.plot_table import TABS
from app.dashboard.transport.callback_errors import guarded
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.page.file_delivery import FileDelivery
from app.export.export_jobs import (
    PLAYBACK_LIMIT,
    DataFormat,
    DataJob,
    FigureJob,
    PlaybackJob,
    file_name,
)
from app.export.figures import DOUBLE, MM, SINGLE, FigureOptions
from app.export.formats import ALL_PLOTS, Format
from app.export.playback_frames import playback_frames
from app.scenario.data import from_file, to_toml
from app.scenario.errors import ScenarioError
from app.session.commands import Load
from app.session.snapshot import Snapshot, as_recorded
from app.storage.recording_files import ProgressCallback, table

MEGABYTE = 1e6
DATA_LIMIT = 256 * MEGABYTE  # a browser receives this through a web socket without trouble
RENDERING = 60.0  # s in which a page must render a picture, since a hidden page never answers

OnClick = Callable[[viser.GuiEvent[viser.GuiButtonGroupHandle]], None]
Make = Callable[[ProgressCallback], bytes]


WIDTHS = {"as the plots need": None, "one column, 85 mm": SINGLE, "two columns, 180 mm": DOUBLE}
TYPES = {f"{size} pt": float(size) for size in (7, 6, 8, 9, 10, 12)}
SHOWN, WHOLE = "as shown by the plots", "the whole run"


def _inches(text: str) -> float | None:
    """Length in inches of a text in mm, None for an empty one. Raises ValueError."""
    try:
        return float(text) * MM if text.strip() else None
    except ValueError as error:
        raise ValueError(f"height: {text.strip()!r:.40}; allowed: a number of mm, or nothing") from error


@dataclass(frozen=True)
class _Part:
    """Part of the run that a file is made of, from `begin` to `end`, s. snapshot: of the end."""

    snapshot: Snapshot
    begin: float
    end: float

    def file_name(self, extension: str, content: str = "") -> str:
        """Name that tells files of other parts and contents apart. content: see `export_jobs.file_name`."""
        begin = max(self.begin, self.snapshot.recording.first)  # what is older has been forgotten
        return file_name(self.snapshot.scenario.name, self.end, extension, content, begin)


class ExportPanel:
    """Export panel. Each file is made from the present snapshot in another process, so that the run goes on; one file
    at a time, see `FileDelivery`."""

    holds: ClassVar = "figure, data (CSV, NPZ), 3-D playback, 3-D picture, scenario file, load a scenario"

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._delivery = FileDelivery()
        gui = desk.gui
        plots = (ALL_PLOTS, *TABS, *(plot.name for plot in plots_of([ALL_PLOTS])))
        self._plots = gui.add_dropdown("Figure of", plots, hint="All plots, those of a tab, or a single one.")
        self._lines = gui.add_text("Lines", "", hint="Names from the legends, separated by commas; empty: all.")
        self._width = gui.add_dropdown("Width", tuple(WIDTHS), hint="Width of a column or of a page of a journal.")
        self._height = gui.add_text("Height [mm]", "", hint="Height of the figure; empty: as the plots need.")
        self._type = gui.add_dropdown("Text size", tuple(TYPES), hint="Of the figure.")
        self._letters = gui.add_checkbox("Letters (a), (b)", False, hint="Puts letters before the titles of the plots.")
        self._caption = gui.add_checkbox("Caption", True, hint="Puts the scenario's numbers below the figure.")
        self._buttons(
            "Figure",
            ("SVG", "PDF", "PNG"),
            self._on_figure,
            "Plots and scenario on white, as shown now, with the pinned runs.",
        )
        self._part = gui.add_dropdown("Part of the run", (SHOWN, WHOLE), hint="For the data and the 3-D playback.")
        self._buttons("Data", ("CSV", "NPZ"), self._on_data, "Every signal, every control period, in SI units.")
        self._buttons("3-D playback", ("HTML",), self._on_playback, "A page that plays without this program.")
        self._buttons(
            "3-D picture",
            ("1×", "2×"),
            self._on_picture,
            "The scene as shown now, at once or twice its size in pixels.",
        )
        self._buttons("Scenario", ("TOML",), self._on_scenario, "To load here, to share, or for `vsmrc run`.")
        self._upload = gui.add_upload_button("Load a scenario (TOML)", mime_type=".toml,application/toml")
        self._upload.on_upload(self._on_upload)

    def show(self, snapshot: Snapshot) -> None:
        """Do nothing: no widget of this panel depends on the scenario."""

    def _shown(self) -> _Part:
        """Stretch of the run that the plots show now."""
        snapshot = self._desk.snapshot()
        return _Part(snapshot, snapshot.t - self._desk.viewing.window, snapshot.t)

    def _chosen(self) -> _Part:
        """Stretch of the run that is chosen for the data and the playback."""
        if self._part.value != WHOLE:
            return self._shown()
        snapshot = self._desk.snapshot().at_end
        return _Part(snapshot, -math.inf, snapshot.end)

    def _buttons(self, label: str, options: tuple[str, ...], on_click: OnClick, hint: str) -> None:
        group = self._desk.gui.add_button_group(label, options, hint=hint)
        group.on_click(guarded(on_click, self._desk.complain))

    # these callbacks are synchronous, unlike those that post commands: each waits for a file in a thread of viser's
    # pool

    def _on_figure(self, event: viser.GuiEvent) -> None:
        form: Format = event.target.value.lower()
        viewing, part, chosen = self._desk.viewing, self._shown(), (self._plots.value,)
        lines = tuple(name for name in map(str.strip, self._lines.value.split(",")) if name)
        try:
            options = FigureOptions(
                width=WIDTHS[self._width.value],
                height=_inches(self._height.value),
                type_size=TYPES[self._type.value],
                letters=self._letters.value,
                caption=self._caption.value,
            )
        except ValueError as error:
            self._desk.complain(f"figure: {error}")
            return

        def make(on_progress: ProgressCallback) -> bytes:
            drawn = as_recorded(part.snapshot, part.begin, part.end)
            setup = Setup.of(drawn, viewing.coordinate, viewing.joint)
            pinned = tuple(map(PinnedChart.of, drawn.pinned))
            figure = figure_of(plots_of(chosen), drawn, setup, part.begin, part.end, pinned)
            chosen_lines = with_series(figure, lines, called="Lines")
            return self._desk.export_jobs.made(FigureJob(chosen_lines, form, options), on_progress)

        self._delivery.give(event, "Figure", part.file_name(form, figure_name(chosen, lines)), make)

    def _on_data(self, event: viser.GuiEvent) -> None:
        form: DataFormat = event.target.value.lower()
        part = self._chosen()

        def make(on_progress: ProgressCallback) -> bytes:
            snapshot = part.snapshot
            rows = table(snapshot.scenario, snapshot.recording, part.begin, part.end, snapshot.stop)
            return self._desk.export_jobs.made(DataJob(rows, form, DATA_LIMIT), on_progress)

        self._delivery.give(event, "Data", part.file_name(form), make)

    def _on_playback(self, event: viser.GuiEvent) -> None:
        viewing, part = self._desk.viewing, self._chosen()

        def make(on_progress: ProgressCallback) -> bytes:
            begin, end = part.begin, part.end
            last = as_recorded(part.snapshot, begin, end)
            frames = playback_frames(last.scenario, last.recording, begin, end)
            setup = Setup.of(last, viewing.coordinate, viewing.joint)
            figure = figure_of(plots_of(BESIDE_PLAYBACK), last, setup, begin, end)
            return self._desk.export_jobs.made(PlaybackJob(frames, PLAYBACK_LIMIT, figure), on_progress)

        self._delivery.give(event, "3-D playback", part.file_name("html"), make)

    def _on_picture(self, event: viser.GuiEvent) -> None:
        client, scale = event.client, 2 if event.target.value == "2×" else 1
        if client is None:
            return

        def make(on_progress: ProgressCallback) -> bytes:
            on_progress(0.0)
            # the camera's size is that of the pixels that viser draws, fewer on a slow machine
            width, height = self._desk.scene_of(client.client_id) or (
                client.camera.image_width,
                client.camera.image_height,
            )
            picture = client.get_render(scale * height, scale * width, transport_format="png", timeout=RENDERING)
            file = io.BytesIO()
            Image.fromarray(picture).save(file, "png")
            return file.getvalue()

        content = "scene" if scale == 1 else f"scene {scale}x"
        snapshot = self._desk.snapshot()
        name = file_name(snapshot.scenario.name, snapshot.t, "png", content)
        self._delivery.give(event, "3-D picture", name, make, maker=client.client_id)

    def _on_scenario(self, event: viser.GuiEvent) -> None:
        snapshot = self._desk.snapshot()
        name = file_name(snapshot.scenario.name, snapshot.t, "toml")
        self._delivery.give(event, "Scenario", name, lambda _: to_toml(snapshot.scenario).encode())

    async def _on_upload(self, event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
        if event.client is None:
            return
        name, content = event.target.value.name, event.target.value.content
        try:
            self._desk.post(Load(await asyncio.to_thread(from_file, content)))
        except ScenarioError as error:
            self._desk.complain(f"{name:.60}: {error}")
