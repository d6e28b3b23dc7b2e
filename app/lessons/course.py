"""Course of a session through a lesson: the step that is shown, the answers, and the outcomes of its runs so far."""

from __future__ import annotations

import threading

import msgspec

from app.lessons.answers import (
    Answer,
    LessonProgress,
    Notebook,
    Score,
    admitted,
    score_choice,
    score_curve,
    score_number,
)
from app.lessons.blocks import ChoiceQuestion, CurveQuestion, Explain, Goal, LessonRun, NumberQuestion
from app.lessons.checking import trace_for
from app.lessons.lesson import Lesson, LessonStep
from app.lessons.measures import MeasuredNumber
from app.lessons.playing import LessonOutcome, Trace, play, runs
from app.lessons.words import LessonWords, words_of
from app.scenario.errors import ScenarioError
from app.simulation.omega.search_memory import Memory


class LessonCourse:
    """Course of one session through one lesson. Safe to use from several threads.

    A prediction can be given once, before its run; it is scored at the next explanation. Which run has been seen is
    kept with the answers: to leave the lesson and come back opens no prediction again. Where the progress cannot be
    written, a method raises OSError after all else is done.
    """

    def __init__(self, lesson: Lesson, notebook: Notebook) -> None:
        self.lesson, self._notebook = lesson, notebook
        self._lock, self._left = threading.RLock(), False
        self.outcomes: dict[int, LessonOutcome] = {}
        # the lesson may have been another one when its progress was kept
        if not 1 <= self.progress.step <= len(lesson.steps):
            self._note(step=1)
        if self.progress.seen not in {0, *(run.number for run in runs(lesson))}:
            self._note(seen=0)
        fitting = {number: answer for number, answer in self.progress.answers.items() if self._fits(number, answer)}
        if fitting != self.progress.answers:
            self._note(answers=fitting)

    @property
    def progress(self) -> LessonProgress:
        return self._notebook.of(self.lesson.name)

    @property
    def words(self) -> LessonWords:
        """Words of the program in the lesson's language."""
        return words_of(self.lesson.head.language)

    @property
    def step(self) -> LessonStep:
        """Step that the page shows."""
        return self.lesson.steps[self.progress.step - 1]

    @property
    def answer(self) -> Answer | None:
        """Answer to the question of the shown step."""
        return self.progress.answers.get(self.step.number)

    @property
    def measurements(self) -> dict[str, MeasuredNumber]:
        """Measured numbers of the runs up to the shown step, by name."""
        known: dict[str, MeasuredNumber] = {}
        for number, outcome in sorted(self.outcomes.items()):
            if number <= self.step.number:
                known |= outcome.measurements
        return known

    @property
    def measured(self) -> dict[str, str]:
        """Measured numbers of the runs up to the shown step as text in the lesson's language, by name."""
        return {name: number.text(self.lesson.head.language) for name, number in self.measurements.items()}

    @property
    def last_run(self) -> LessonStep | None:
        """Step of the last run up to the shown step, None where an explanation came after it."""
        for step in reversed(self.lesson.steps[: self.step.number]):
            if step.run:
                return step
            if isinstance(step.block, Explain) and step.number < self.step.number:
                return None
        return None

    @property
    def missing(self) -> list[LessonStep]:
        """Steps of the runs before the shown step that have no outcome, such as after a restart."""
        earlier = self.lesson.steps[: self.step.number - 1]
        return [step for step in earlier if step.run and step.number not in self.outcomes]

    @property
    def ready(self) -> bool:
        """Whether the shown step has been done."""
        match self.step.block:
            case ChoiceQuestion() | NumberQuestion() | CurveQuestion():
                return self.answer is not None
            case LessonRun():
                return self.step.number in self.outcomes
            case Goal():
                return self.step.number in self.progress.goals
            case _:
                return True

    @property
    def open(self) -> bool:
        """Whether the question of the shown step can still be answered: it was not, and no run that it predicts has
        been seen."""
        predicts = self.step.kind == "predict"
        return self.answer is None and not (predicts and self.step.number <= self.progress.seen)

    def traces(self, run: LessonStep) -> list[Trace]:
        """Lines of a run's picture, those of the earlier runs that it is compared with first."""
        block = run.block
        assert isinstance(block, LessonRun)
        if run.number not in self.outcomes:
            return []
        titles = {
            earlier.title: step.number
            for step in self.lesson.steps[: run.number - 1]
            if (earlier := step.run) and step.number in self.outcomes
        }
        beside = [
            trace
            for title in block.beside
            if title in titles
            for trace in self.outcomes[titles[title]].traces
            if any(trace.line.shows(line) for line in block.show)
        ]
        return [*beside, *self.outcomes[run.number].traces]

    def predictions(self, run: LessonStep) -> list[tuple[LessonStep, Answer]]:
        """Predictions for a run: answered questions since the run or explanation before it."""
        found = []
        for step in reversed(self.lesson.steps[: run.number - 1]):
            if isinstance(step.block, LessonRun | Explain):
                break
            if step.kind == "predict" and (answer := self.progress.answers.get(step.number)) is not None:
                found.append((step, answer))
        return found[::-1]

    def explained(self) -> list[tuple[LessonStep, Answer]]:
        """Answered questions since the explanation before the shown step, with their scores."""
        found = []
        for step in reversed(self.lesson.steps[: self.step.number - 1]):
            if isinstance(step.block, Explain):
                break
            if step.question is not None and (answer := self.progress.answers.get(step.number)) is not None:
                found.append((step, answer))
        return found[::-1]

    def give(self, given: object) -> None:
        """Answer the question of the shown step, once. Raises ScenarioError."""
        with self._lock:
            question = self.step.question
            if question is None:
                raise ScenarioError("answer: there is no question; allowed: where one is asked")
            if self.answer is not None:
                raise ScenarioError("answer: it is locked, as one was given before; allowed: one to each question")
            if not self.open:
                raise ScenarioError("answer: it is locked, as the run has been seen; allowed: before it")
            self._answer(self.step, Answer(admitted(question, given)))
        self._notebook.save()

    def take(self, run: LessonStep, outcome: LessonOutcome) -> None:
        """Keep the outcome of a run, which has been seen now."""
        self._take(run, outcome)
        self._notebook.save()

    def make_up(self, memory: Memory | None = None) -> None:
        """Play the missing runs, and score what was predicted of them where it is explained. Raises ScenarioError."""
        for run in self.missing:
            if self._left:
                return
            self._take(run, play(run, memory))
        with self._lock:
            if self._left:
                return
            if isinstance(self.step.block, Explain):
                self._score()
        self._notebook.save()

    def leave(self) -> None:
        """Leave the lesson: a run that is still being computed has not been seen."""
        with self._lock:
            self._left = True

    def reached_goal(self) -> None:
        """Note that the goal of the shown step is reached."""
        with self._lock:
            if self.step.number in self.progress.goals:
                return
            self._note(goals=(*self.progress.goals, self.step.number))
        self._notebook.save()

    def go(self, by: int) -> None:
        """Show another step. by: steps further on, negative for back."""
        with self._lock:
            number = min(max(self.progress.step + by, 1), len(self.lesson.steps))
            self._note(step=number, finished=self.progress.finished or number == len(self.lesson.steps))
            if isinstance(self.step.block, Explain):
                self._score()
        self._notebook.save()

    def _take(self, run: LessonStep, outcome: LessonOutcome) -> None:
        with self._lock:
            if self._left:
                return
            self.outcomes = {**self.outcomes, run.number: outcome}
            self._note(seen=max(self.progress.seen, run.number))

    def _fits(self, number: int, answer: Answer) -> bool:
        """Whether the step of this number asks a question to which this is an answer."""
        question = self.lesson.steps[number - 1].question if 1 <= number <= len(self.lesson.steps) else None
        if question is None:
            return False
        try:
            admitted(question, answer.given)
        except ScenarioError:
            return False
        return True

    def _score(self) -> None:
        """Score the answers up to the shown step whose runs have been measured."""
        for step in self.lesson.steps[: self.step.number]:
            answer = self.progress.answers.get(step.number)
            if answer is not None and answer.score is None and (score := self._score_of(step, answer)) is not None:
                self._answer(step, Answer(answer.given, score.points, score.feedback))

    def _score_of(self, step: LessonStep, answer: Answer) -> Score | None:
        match step.block, answer.given:
            case ChoiceQuestion() as question, int() as given:
                return score_choice(question, given, self.words)
            case NumberQuestion() as question, float() | int() as given if question.measure in self.measurements:
                return score_number(question, given, self.measurements, self.words)
            case CurveQuestion() as question, list() as given if (trace := trace_for(step, self.outcomes)) is not None:
                return score_curve(question, given, trace, self.words)
            case _:
                return None

    def _answer(self, step: LessonStep, answer: Answer) -> None:
        self._note(answers={**self.progress.answers, step.number: answer})

    def _note(self, **changes: object) -> None:
        self._notebook.note(self.lesson.name, msgspec.structs.replace(self.progress, **changes))
