"""Controls of a search for better gains: the gains that it varies, its aims, and its candidates, of which one can be
previewed and then applied."""

from __future__ import annotations

from html import escape

import viser

from app.dashboard.transport.callback_errors import guarded
from app.dashboard.widgets.families.background_work import BackgroundWork, earlier_html, task_of, with_least_duration
from app.dashboard.widgets.families.candidate_chart import FIELD, candidates_html, gains_in_words, name_of
from app.dashboard.widgets.families.robustness_map import ARMS
from app.dashboard.widgets.families.swept_fields import (
    GAINS,
    NONE,
    Field,
    FieldChoice,
    field_of_row,
    number_of,
    prepared,
    require_arms,
    require_ends,
)
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.fields.field_binding import NumberRow
from app.dashboard.widgets.run.whatif import HeldControl
from app.export.export_jobs import MadeJob, file_name
from app.scenario.data import differences, field_of, with_values
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.commands import EditAll
from app.session.snapshot import Snapshot
from app.simulation.builders.controller_builder import law_of
from app.storage.recording_files import ProgressCallback
from app.tune.background import BackgroundTuning
from app.tune.candidates import Candidate
from app.tune.offers import offered
from app.tune.plan import Tuning, is_gain, known_aims, require_sound
from app.tune.running import TuningResult, most_runs

MOST = 4  # gains that a search may vary
AIMS = {
    "force error": "force_error",
    "path error": "motion_error",
    "angle error": "angle_error",
    "torque variation": "torque_variation",
    "settling time": "settling_time",
    "residual of (8)": "residual",
}
BUDGETS = {"32": 32, "64": 64, "128": 128}
NOT_OFFERED = "not offered"
AGAIN = "click again: apply"


class GainSearch(BackgroundWork[BackgroundTuning]):
    """Controls of the search and its picture, in the current container."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk, "Search", "Cancel the search")
        gui = desk.gui
        self._names: dict[str, str] = {}
        self._fields: list[Field] = []
        self._chosen: int | None = None
        self._told: TuningResult | None = None  # what the sentences at the end are about
        gui.add_html(
            '<div class="vs-note">Which gains may move, within which ranges, and what is to be '
            "small? The answer is that of <code>vsmrc tune</code>. A candidate over a limit is never offered.</div>"
        )
        firsts = ("boundary layer", "reaching gain K_s", NONE, NONE)
        self._moves = [
            FieldChoice(desk, f"Gain {k + 1}", GAINS, first, optional=True) for k, first in enumerate(firsts)
        ]
        self._first = gui.add_dropdown(
            "What counts", tuple(AIMS), hint="The smaller the better. Errors: in each run's last fifth."
        )
        self._second = gui.add_dropdown(
            "What else counts", (NONE, *AIMS), initial_value="torque variation", hint="Of two, a front is found."
        )
        self._arms = gui.add_dropdown(
            "Judged by", tuple(ARMS), initial_value="4 of the declared set", hint="By the worst of these true arms."
        )
        self._budget = gui.add_dropdown("Candidates", tuple(BUDGETS), initial_value="32")
        self._unseen = gui.add_text(
            "Test arms", "8", hint="Arms that the search does not use and that test its result, 1 to 64."
        )
        self._add_length()
        self._seed = gui.add_text("Seed", "0", hint="The same seed has the same answer.")
        self._add_button()
        self._conclusions = gui.add_html("")
        self._file = gui.add_button("This search as a folder", color="gray", visible=False, hint="As `vsmrc tune` has.")
        self._add_mark(FIELD)
        self._file.on_click(guarded(self._on_file, desk.complain))

    def let_move(self, row: NumberRow) -> None:
        """Let the search vary the field of this row, around its present value. Raises ScenarioError."""
        field = field_of_row(row, self._desk.snapshot())
        if not is_gain(field.path):
            raise ScenarioError(f"{field.name}: no gain; allowed: fields of the tabs Controller and Model")
        same = [each for each in self._moves if each.field is not None and each.field.path == field.path]
        free = [each for each in self._moves if each.field is None]
        (same or free or self._moves[-1:])[0].choose(field)

    def _begin(self, snapshot: Snapshot) -> BackgroundTuning:
        fields, request = self._request(snapshot)
        begun = self._desk.background_jobs.begin(
            lambda allowance: BackgroundTuning(request, allowance.workers, allowance.at_once), most_runs(request)
        )
        self._leave()
        self._fields, self._names = fields, self._names | {field.path: field.name for field in fields}
        return begun

    def _request(self, snapshot: Snapshot) -> tuple[list[Field], Tuning]:
        """Fields that the search varies, and the tuning of the present choices. Raises ScenarioError."""
        seconds = self._length()
        unseen, seed = self._whole("Test arms", self._unseen, 1, 64), self._whole("Seed", self._seed, 0, 2**31)
        moves = [each for each in self._moves if each.field is not None]
        fields = [each.field for each in moves if each.field is not None]
        if not fields:
            raise ScenarioError("the gains that may move: none; allowed: one or more")
        if len({field.path for field in fields}) < len(fields):
            raise ScenarioError("the gains that may move: one is there twice; allowed: each once")
        scenario = prepared(snapshot, fields)
        ranges = tuple(each.range(scenario) for each in moves)
        for field, axis in zip(fields, ranges, strict=True):
            require_ends(scenario, field.name, axis)
        request = Tuning(
            with_least_duration(scenario, seconds),
            ranges,
            points=BUDGETS[self._budget.value] + 1,
            draw=ARMS[self._arms.value],
            seed=seed,
            until=seconds,
            engine="compiled" if law_of(scenario).compiled else "pinocchio",  # which alone takes plain numpy
            aims=self._aims(scenario),
            unseen=unseen,
        )
        if request.draw:
            require_arms(request, f"Judged by: {self._arms.value}", "the scenario's own with 1 under Test arms")
        else:
            require_arms(request, f"Test arms: {unseen}", "1")
        require_sound(request)
        return fields, request

    def _aims(self, scenario: Scenario) -> tuple[str, ...]:
        """Aims that are chosen. Raises ScenarioError for one that is chosen twice, and for one that no run has."""
        first, second = self._first.value, self._second.value
        if first == second:
            raise ScenarioError(f"What else counts: {second}, as what counts; allowed: something else, or {NONE}")
        known = [title for title, aim in AIMS.items() if aim in known_aims(scenario)]
        for label, title in (("What counts", first), ("What else counts", second)):
            if title not in (NONE, *known):
                raise ScenarioError(
                    f"{label}: {title}, which no run of this scenario in {scenario.mode} mode has; allowed: "
                    f"{', '.join(known)}"
                )
        return tuple(AIMS[title] for title in (first, second) if title != NONE)

    def _whole(self, name: str, text: viser.GuiInputHandle[str], least: int, most: int) -> int:
        value = number_of(name, text.value)
        if value != int(value) or not least <= value <= most:
            raise ScenarioError(f"{name}: {text.value.strip()!r:.40}; allowed: {least} to {most}")
        return int(value)

    def _choose(self, work: BackgroundTuning, number: str, client: int) -> None:
        candidate = next((each for each in work.candidates if str(each.number) == number), None)
        if candidate is None:
            self._leave()
            return
        snapshot = self._desk.snapshot()
        if task_of(work.tuning.scenario) != task_of(snapshot.scenario):
            self._desk.complain(
                f"{name_of(candidate.number)}: of an earlier scenario, whose gains mean something else; allowed: a "
                "search for the present one"
            )
            return
        try:
            edit = self._edit(snapshot, candidate)
        except ScenarioError as error:
            self._desk.complain(str(error))
            return
        held = self._desk.whatif.held
        if self._chosen == candidate.number and held is not None and (held.control, held.client) == (self, client):
            if candidate.badge and candidate.number:
                self._desk.complain(f"candidate {candidate.number}: not offered, {candidate.badge}")
            elif self._desk.post(edit) is not None:
                self._desk.whatif.remember(snapshot, edit)
            self._leave()
            return
        self._chosen, self._due = candidate.number, 0.0
        name = name_of(candidate.number)
        gains = gains_in_words(work, candidate, self._names) or name
        then = NOT_OFFERED if candidate.badge and candidate.number else AGAIN
        self._desk.whatif.hold(HeldControl(edit, name, gains, self, client, snapshot.run, then))

    def _edit(self, snapshot: Snapshot, candidate: Candidate) -> EditAll:
        """Command that gives the running scenario the gains of a candidate. Raises ScenarioError."""
        tuning = self._work
        assert tuning is not None
        now, before = snapshot.scenario, tuning.tuning.scenario
        if candidate.number == 0:  # the gains at the start
            fields = {
                path: old for path, (old, _) in differences(before, now).items() if path in _whole_fields(self._fields)
            }
            return EditAll(fields)
        needed = {path: value for field in self._fields for path, value in field.needs(snapshot).items()}
        then = with_values(with_values(now, needed), dict(candidate.values))
        return EditAll({path: new for path, (_, new) in differences(now, then).items()})

    def _leave(self) -> None:
        self._chosen, self._due = None, 0.0
        self._desk.whatif.let_go(self)

    def _on_file(self, event: viser.GuiEvent) -> None:
        """Callback of the button for a file; viser calls it in a thread of its pool, which may wait."""
        tuning, jobs = self._work, self._desk.export_jobs
        if tuning is None or tuning.found is None:
            return
        from app.tune import outcome  # here: pyarrow is large, and few sessions need it

        request = tuning.tuning
        job = MadeJob(outcome.zipped, (request, tuning.rows, tuning.found))
        asked = "-".join((*request.aims, *(axis.path for axis in request.vary), f"seed-{request.seed}"))
        name = file_name(f"{request.scenario.name}-search", request.length, "zip", asked)

        def make(on_progress: ProgressCallback) -> bytes:
            return jobs.made(job, on_progress)

        self._delivery.give(event, "Search", name, make)

    def show(self, snapshot: Snapshot) -> None:
        """Show the candidates so far."""
        count = sum(each.field is not None for each in self._moves)
        for k, each in enumerate(self._moves):
            each.show(snapshot.system.units)
            each.show_whole(visible=each.field is not None or k <= count)
        if self._chosen is not None and not self._desk.whatif.holds(self):
            self._chosen, self._due = None, 0.0  # the preview was reverted, or replaced by that of a slider
        super().show(snapshot)

    def _drawn(self, work: BackgroundTuning, snapshot: Snapshot) -> str:
        if work.found is not self._told:
            self._told = work.found
            self._conclusions.content = "" if work.found is None else _conclusions_html(work.tuning, work.found)
        if self._file.visible != (work.found is not None):
            self._file.visible = work.found is not None
        present = task_of(work.tuning.scenario) == task_of(snapshot.scenario)
        return ("" if present else earlier_html("The search")) + candidates_html(work, self._names, self._chosen)


def _conclusions_html(tuning: Tuning, found: TuningResult) -> str:
    """Sentences on what a search has found, as HTML."""
    from app.tune import outcome  # here: pyarrow is large, and few sessions need it

    names = {each.number: name_of(each.number) for each in offered(tuning, found)}
    sentences = "".join(f"<div>{escape(sentence)}.</div>" for sentence in outcome.conclusions(tuning, found, names))
    return f'<div class="vs-note">{sentences}</div>'


def _whole_fields(fields: list[Field]) -> set[str]:
    """Paths of the scenario's fields that contain these fields: without the index of an entry."""
    return {field_of(field.path) for field in fields}
