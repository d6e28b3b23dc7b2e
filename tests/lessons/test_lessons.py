"""Lessons: the shipped ones are fit to be given, and a lesson that is not is refused for what is wrong with it."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from app.cli.commands import execute
from app.lessons.blocks import ChoiceQuestion
from app.lessons.checking import check
from app.lessons.lesson import Lesson, LessonError, LessonStep, load, read, shipped_lessons
from app.storage.constants_store import kept_memory

DOCS = Path(__file__).parents[2] / "docs" / "lessons.md"
LESSON = """\
```lesson
title = "A test"
minutes = 4
knows = ["what a test is"]
```
A spring of $K_m = 2000$ N/m.
```scenario
base = "ur5-impedance"
[set]
"contact.kind" = "free"
motion = "hold"
"truth.push_start" = 0.2
"target_model.K_m.2" = 1000.0
```
```predict
kind = "number"
ask = "How far, in mm?"
measure = "way"
tolerance = 1.0
wrong = [15.0]
```
```predict
kind = "curve"
ask = "Draw it."
start = 0.0
end = 1.0
low = -10.0
high = 40.0
tolerance = 3.0
wrong = [[[0.0, 0.0], [1.0, 0.0]]]
line = { signal = "e_r.2", unit = "mm", title = "way" }
```
```predict
kind = "choice"
ask = "Which way?"
options = ["there", "back"]
right = 1
because = [{ measure = "way", above = 20.0 }]
```
```run
title = "pushed"
seconds = 1.0
show = [{ signal = "e_r.2", unit = "mm", title = "way" }]
measures.way = { signal = "e_r.2", statistic = "largest", unit = "mm" }
edits = [{ at = 0.5, set = "target_model.K_m.2", value = 900.0 }]
```
```observe
kind = "choice"
ask = "Seen? {{way}}"
options = ["yes", "no"]
right = 1
```
It went {{way}}.
```explain
equation = "(27)"
```
```goal
ask = "Make it stiff."
seconds = 1.0
controls = [
  { path = "target_model.K_m.2", label = "K", low = 500.0, high = 9000.0, reference = 8000.0, wrong = 1500.0 },
]
measures.way = { signal = "e_r.2", statistic = "largest", last = 0.5, unit = "mm" }
conditions = [{ measure = "way", below = 8.0 }]
```
"""


def lesson(*changes: tuple[str, str]) -> Lesson:
    text = LESSON
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return read(text, "test", "test/lesson.md")


def test_the_right_answer_is_at_no_place_more_often_than_elsewhere() -> None:
    questions = [step.question for name in shipped_lessons() for step in load(name).steps]
    right = [each.right for each in questions if isinstance(each, ChoiceQuestion) and len(each.options) > 2]
    assert len(right) > 30
    assert {1, 2, 3} <= set(right)
    assert max(map(right.count, right)) <= 0.5 * len(right)


@pytest.mark.slow
@pytest.mark.parametrize("name", shipped_lessons())
def test_every_shipped_lesson_is_fit_to_be_given(name: str) -> None:
    checked = check(load(name), kept_memory())
    assert not checked.problems
    assert len(checked.measurements) >= 3
    assert sum(step.question is not None for step in checked.lesson.steps) >= 3


def test_there_are_twelve_lessons_and_two_of_them_in_german() -> None:
    languages = [each.head.language for each in shipped_lessons().values()]
    assert (languages.count("en"), languages.count("de")) == (12, 2)


@pytest.mark.parametrize("name", ["03-wall", "05-heavy-arm"])
def test_a_translation_has_the_same_steps_numbers_and_answers(name: str) -> None:
    original, translated = load(name), load(f"{name}.de")
    for one, other in zip(original.steps, translated.steps, strict=True):
        assert (one.kind, type(one.block), one.scenario) == (other.kind, type(other.block), other.scenario)
        for field in ("right", "measure", "tolerance", "wrong", "because", "conditions", "seconds"):
            assert getattr(one.block, field, None) == getattr(other.block, field, None)
        measures = (getattr(step.block, "measures", {}) for step in (one, other))
        untitled, translated_ones = ({name: replace(each, title=None) for name, each in of.items()} for of in measures)
        assert untitled == translated_ones


def test_the_lesson_of_the_documents_is_one() -> None:
    text = DOCS.read_text(encoding="utf-8")
    example = text.partition("<!-- example -->\n````markdown\n")[2].partition("\n````")[0]
    assert 25 <= len(example.splitlines()) <= 36
    assert not check(read(example, "example", "docs/lessons.md")).problems


def test_a_lesson_with_every_kind_of_step_is_checked_without_a_problem() -> None:
    checked = check(lesson())
    assert not checked.problems
    assert {step.kind for step in checked.lesson.steps} == {"scenario", "predict", "run", "observe", "explain", "goal"}
    assert checked.measurements["way"].unit == "mm"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("wrong = [15.0]", "wrong = [15.0, 27.5]", "the planted wrong answer 27.5 counts in full"),
        ('measure = "way"', 'measure = "far"', "measure 'far': no run before the explanation measures it"),
        ("[[[0.0, 0.0], [1.0, 0.0]]]", "[[[0.0, 0.0], [0.2, 0.0], [0.5, 20.0], [1.0, 28.5]]]", "planted wrong course"),
        ("high = 40.0", "high = 20.0", "low, high: what is measured goes from"),
        ("above = 20.0", "above = 200.0", "way is 27.9 mm; wanted: above 200 mm"),
        ('signal = "e_r.2", statistic', 'signal = "e_r.9", statistic', "signal: 'e_r.9'; allowed: e_r.1 to e_r.6"),
        ('statistic = "largest", unit', 'statistic = "largest", start = 5.0, unit', "nothing is recorded from 5 s"),
        ('statistic = "largest", unit = "mm"', 'statistic = "largest", unit = "inch"', "unit: 'inch'; allowed:"),
        ("It went {{way}}", "It went {{weg}}", "{{weg}} stands in the text and was not measured before"),
        ("value = 900.0", "value = -900.0", "refused: nothing; what happened: target_model.K_m"),
        ('title = "pushed"', 'title = "pushed"\nstops = "lost"', "stops: lost; what happened: nothing"),
        ('title = "pushed"', 'title = "pushed"\nbeside = ["pulled"]', "beside: 'pulled'; allowed: titles of earlier"),
        ("wrong = 1500.0", "wrong = 7000.0", "the planted wrong values reach the goal"),
        ("reference = 8000.0", "reference = 2000.0", "with the reference, way is"),
        ("below = 8.0", "below = 80.0", "the goal is reached before anything is done"),
        ("minutes = 4", "minutes = 60", "minutes, and says 60"),
        ("seconds = 1.0", "seconds = 0.0004", "run: nothing is recorded: seconds: 0.0004; allowed: at least a control"),
        ("value = 900.0 }]", 'value = 0.0 }]\nrefused = "B_m"', "refused: B_m; what happened: target_model.K_m"),
        (
            'edits = [{ at = 0.5, set = "target_model.K_m.2", value = 900.0 }]',
            'edits = [{ at = 0.5, set = "mode", value = "motion" }]',
            "edits: mode begins a run anew",
        ),
    ],
)  # fmt: skip
def test_a_lesson_that_misleads_is_not_fit_and_the_check_says_where(old: str, new: str, sentence: str) -> None:
    checked = check(lesson((old, new)))
    assert any(sentence in problem for problem in checked.problems), checked.problems
    assert all(problem.startswith("test/lesson.md") for problem in checked.problems)


STOPPING = """
```scenario
base = "ur5-constrained"
[set]
"target_model.K_f" = [0.2, 0.0, 0.0, 0.0, 0.0, 0.0]
```
```goal
ask = "Stay in contact."
seconds = 0.1
controls = [{ path = "target_model.K_f.1", label = "K_f", low = 0.1, high = 5.0, reference = 2.0, wrong = 0.2 }]
measures.force = { signal = "force_error", statistic = "largest", unit = "N" }
conditions = [{ measure = "force", below = 1000.0 }]
```
"""


@pytest.mark.slow
def test_a_goal_whose_run_stops_is_missed() -> None:
    """The wrong value loses contact, which is where the run begins, too, before anything is done."""
    text = LESSON[: LESSON.index("A spring of")] + STOPPING
    stops, reaches = "with the reference, the run stops: t = 0.0", "the planted wrong values reach the goal"
    for reference, wrong, sentences in ((2.0, 0.2, []), (0.2, 0.2, [stops]), (0.2, 2.0, [stops, reaches])):
        values = f"reference = {reference}, wrong = {wrong}"
        changed = text.replace("reference = 2.0, wrong = 0.2", values)
        problems = check(read(changed, "test", "test/lesson.md")).problems
        about_goal = [problem for problem in problems if "goal: " in problem]
        assert len(about_goal) == len(sentences), problems
        assert all(f"goal: {told}" in problem for told, problem in zip(sentences, about_goal, strict=True))


EDIT = 'edits = [{ at = 0.5, set = "target_model.K_m.2", value = 900.0 }]'
WAY = 'measures.way = { signal = "e_r.2", statistic = "largest", unit = "mm" }'
SHOWN = 'show = [{ signal = "e_r.2", unit = "mm", title = "way" }]\n'
CORNER = ('base = "ur5-impedance"\n[set]\n"contact.kind" = "free"\nmotion = "hold"\n"truth.push_start" = 0.2\n'
    '"target_model.K_m.2" = 1000.0', 'base = "planar3r-corner"')  # fmt: skip
TOUCHING = ('"contact.kind" = "free"\n', "")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ([TOUCHING, (WAY, 'measures.way = { signal = "force_error", unit = "N" }')],
         "signal: 'force_error' in impedance mode, which controls no force; allowed: contact_force"),
        ([TOUCHING, (SHOWN, SHOWN.replace("e_r.2", "force_error").replace("mm", "N"))],
         "signal: 'force_error' in impedance mode, which controls no force; allowed: contact_force"),
        ([CORNER, (EDIT, ""), (WAY, 'measures.way = { signal = "path_error", unit = "mm" }')],
         "signal: 'path_error' where every position is pressed; allowed: where one is free"),
        ([(WAY, WAY.replace('"mm"', '"mN"'))], "unit: 'mN' of the signal e_r.2; allowed: m, mm, µm"),
        ([(SHOWN, SHOWN.replace('"mm"', '"N"'))], "unit: 'N' of the signal e_r.2; allowed: m, mm, µm"),
        ([(WAY, WAY.replace("largest", "variation"))],
         "unit: 'mm' of the variation of the signal e_r.2; allowed: m/s, mm/s"),
        ([("motion = \"hold\"", "motion = \"hold\"\n\"controller.law\" = \"computed-torque\""),
          (SHOWN, SHOWN.replace("e_r.2", "s_bound").replace("mm", "mm/s"))],
         "signal: 's_bound', which has no value in this run; allowed: one that the run has"),
        ([(WAY, 'measures.way = { metric = "force_error_tail", unit = "N" }')],
         "metric: 'force_error_tail', which this run does not have; allowed: motion_error_tail"),
        ([(WAY, 'measures.way = { metric = "motion_error_tail", unit = "N" }')],
         "unit: 'N' of the metric motion_error_tail; allowed: m, mm, µm"),
    ],
)  # fmt: skip
def test_a_lesson_on_what_its_run_does_not_have_or_in_another_unit_is_not_fit(
    changes: list[tuple[str, str]], sentence: str
) -> None:
    problems = check(lesson(*changes)).problems
    assert any(f": run: {sentence}" in problem for problem in problems), problems


def test_two_measures_in_different_units_are_not_compared() -> None:
    """In numbers alone 27.9 mm would be above 0.0279 m."""
    far = WAY.replace("measures.way", "measures.far").replace('"mm"', '"m"')
    problems = check(lesson((WAY, f"{WAY}\n{far}"), ("above = 20.0", 'above = "far"'))).problems
    assert [problem.partition(": ")[2] for problem in problems] == [
        "predict: condition on way: it is in mm, and far in m; allowed: two measures in the same unit"
    ]


@pytest.mark.parametrize("value", [-1.0, 0.0])
def test_an_edit_beyond_what_its_field_allows_can_be_the_one_that_must_be_refused(value: float) -> None:
    """The edits after it are made of the values before it."""
    edits = (
        f'edits = [{{ at = 0.3, set = "controller.layer", value = {value} }}, '
        '{ at = 0.5, set = "target_model.K_m.2", value = 900.0 }]\nrefused = "controller.layer"'
    )
    assert not check(lesson((EDIT, edits))).problems


def test_an_edit_of_an_entry_of_a_matrix_is_made() -> None:
    rows = [[float(1000 * (i == k)) for k in range(6)] for i in range(6)]
    matrix = lesson(
        ('"target_model.K_m.2" = 1000.0', f'"target_model.K_m" = {rows}'),
        ('set = "target_model.K_m.2", value = 900.0', 'set = "target_model.K_m.2.2", value = 900.0'),
        ('path = "target_model.K_m.2"', 'path = "target_model.K_m.2.2"'),
    )
    assert not check(matrix).problems


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("```scenario", "```scenery", "line 7: block 'scenery'; allowed: lesson, scenario,"),
        ("```lesson", "", "block lesson"),
        ('title = "A test"', "title = A test", "line 1: lesson: not TOML"),
        ("minutes = 4", "minutes = 4\nauthor = 1", "line 1: lesson: author: no such field; allowed: title"),
        ("minutes = 4", 'minutes = "4"', "line 1: lesson: minutes: '4'; allowed: a number"),
        ('base = "ur5-impedance"', 'base = "ur6-impedance"', "line 7: base: 'ur6-impedance'; allowed:"),
        ("target_model.K_m.2", "target_model.K_n.2", "line 7: target_model.K_n.2: no such entry"),
        ("target_model.K_m.2", "target_model.K_m.7", "line 7: target_model.K_m.7: no such entry"),
        ("target_model.K_m.2", "target_model.Q", "line 7: target_model.Q: no such field"),
        ('kind = "number"', 'kind = "guess"', "line 15: predict: kind: 'guess'; allowed: "),
        ("right = 1", "right = 3", "line 33: predict: right: 3; allowed: 1 to 2"),
        ("end = 1.0", "end = -1.0", "line 22: predict: "),
        (
            "[[[0.0, 0.0], [1.0, 0.0]]]",
            "[[]]",
            "wrong: 0 points; allowed: at least 2 in each curve, from left to right",
        ),
        ("[[[0.0, 0.0], [1.0, 0.0]]]", "[[[1.0, 0.0], [0.0, 0.0]]]", "wrong: 2 points; allowed: at least 2 in each"),
        ('title = "A test"', 'title = "A \\u001b[31mtest"', "line 1: lesson: title: "),
        ("low = 500.0", "low = 9500.0", "low, high: 9500 to 9000; allowed: low below high"),
        ("below = 8.0 }]\n```", "below = 8.0 }]\n", "it has no end"),
        ("below = 8.0 }]\n```", "below = 8.0 }]\n```\nAnd then?", "text below the last block"),
    ],
)
def test_a_file_that_is_no_lesson_is_refused_with_line_and_reason(old: str, new: str, sentence: str) -> None:
    with pytest.raises(LessonError) as refused:
        lesson((old, new))
    message = str(refused.value)
    assert sentence in message
    assert message.startswith("test/lesson.md, line ")
    assert "\n" not in message


def test_the_command_checks_plays_and_lists(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "mine" / "lesson.md"
    file.parent.mkdir()
    file.write_text(LESSON, encoding="utf-8")
    assert execute(["lesson", "check", str(file)]) == 0
    assert execute(["lesson", "run", str(file.parent)]) == 0
    assert "pushed: way = 27.9 mm" in capsys.readouterr().out
    file.write_text(LESSON.replace("wrong = [15.0]", "wrong = [28.0]"), encoding="utf-8")
    assert execute(["lesson", "check", str(file)]) == 2
    assert "line 15: predict: the planted wrong answer 28 counts" in capsys.readouterr().out
    assert execute(["lesson", "list"]) == 0
    assert "12-blends" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("chek",), "lesson 'chek'; allowed: list, check, run; did you mean check?"),
        (("run",), "lesson run: no lesson; allowed: one or more"),
        (("chek", "13-more"), "lesson 'chek'; allowed: list, check, run; did you mean check?"),
        (("list", "nonsense"), "lesson list: 'nonsense' is one name too many; allowed: none"),
        (("list", "--figures", "out"), "lesson list: --figures: no such option; allowed: with `vsmrc lesson run`"),
        (("check", "13-more"), "lesson '13-more': unknown; allowed: a lesson.md or 01-target-model"),
        (("check", "nowhere/lesson.md"), "lesson 'nowhere/lesson.md': cannot be read: No such file or directory"),
    ],
)
def test_a_command_that_makes_no_sense_is_refused_in_a_sentence(
    arguments: tuple[str, ...], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(["lesson", *arguments]) == 2
    assert capsys.readouterr().err.startswith(f"vsmrc: {sentence}")


def test_a_step_names_the_numbers_that_its_text_its_question_or_an_option_contains() -> None:
    plain = ChoiceQuestion(ask="More?", options=("no", "yes"), right=1)
    asking, offering = replace(plain, ask="More than {{a}}?"), replace(plain, options=("no", "{{a}}"))
    given = (("It was.", plain), ("It was {{a}}.", plain), ("It was.", asking), ("It was.", offering))
    steps = [LessonStep(1, 1, "observe", text, block, None) for text, block in given]
    assert [step.names_numbers for step in steps] == [False, True, True, True]
