"""Controls of the page, typed into and let go by a stand-in for viser: what they show once an edit was answered."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from app.dashboard.panels.robot import UNSTATED, StatedBounds
from app.dashboard.panels.task import Shift, TaskPanel
from app.dashboard.theme.style import ENTERED, ESCAPED, RELEASED
from app.dashboard.widgets.families.arm_choice import UrdfBinding
from app.dashboard.widgets.fields import controls, text_field
from app.dashboard.widgets.fields.controls import Dropdown, NumberField, Switch
from app.dashboard.widgets.fields.field_binding import FieldBinding, log_scale
from app.dashboard.widgets.fields.text_field import TextField
from app.scenario.data import edited, shipped
from app.session.commands import Command, Edit, EditAll, Load, Pause, Reset, StepOnce
from app.session.snapshot import PREPARING, Snapshot
from tests.support.page_stand_in import Page

BENT = Path(__file__).parents[1] / "support" / "robots" / "bent3r.urdf"


def test_accepted_text_shows_the_normalised_running_value() -> None:
    page = Page()
    before = page.snapshot().scenario
    field = TextField(page.desk, StatedBounds("declared.delta_G"), "δ_G")
    _, text, _ = page.widgets
    page.give(text, f"2.0{ENTERED}")
    assert page.snapshot().scenario.declared.delta_G == 2.0
    field.show(page.snapshot())
    assert text.value == "2"
    page.desk.post(Load(before))
    field.show(page.snapshot())
    assert text.value == UNSTATED
    page.give(text, f"-1{ENTERED}")  # refused: it stays, to be corrected
    field.show(page.snapshot())
    assert text.value == "-1"


def test_a_text_that_is_not_in_force_says_so_and_is_forgotten_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    page, now = Page(), [0.0]
    monkeypatch.setattr(text_field.time, "monotonic", lambda: now[0])
    field = TextField(page.desk, StatedBounds("declared.delta_G"), "δ_G")
    _, text, note = page.widgets

    def shown() -> tuple[str, str]:
        field.show(page.snapshot())
        return text.value, note.content if note.visible else ""

    assert shown() == (UNSTATED, "")
    for typed, said in (("7", "Not applied yet"), (f"-1{ENTERED}", "Refused, not applied")):
        page.give(text, typed)
        draft, told = shown()
        assert draft == typed.rstrip(ENTERED)
        assert said in told
        assert f"In force: {UNSTATED}" in told
        now[0] += 0.9 * text_field.KEPT
        assert shown() == (draft, told)
        now[0] += 0.2 * text_field.KEPT
        assert shown() == (UNSTATED, "")
    page.give(text, f"2{ENTERED}")
    assert shown() == ("2", "")


def test_a_refused_path_of_a_urdf_stays_to_be_corrected() -> None:
    page = Page()
    field = TextField(page.desk, UrdfBinding(), "path")
    _, text, note = page.widgets
    field.show(page.snapshot())
    assert (text.value, note.visible) == ("", False)
    page.give(text, f"/no/such/arm.urdf{ENTERED}")
    field.show(page.snapshot())
    assert text.value == "/no/such/arm.urdf"
    assert "Refused, not applied. In force: none" in note.content
    page.give(text, f"{BENT}{ENTERED}")
    field.show(page.snapshot())
    assert (text.value, note.visible) == (str(BENT), False)
    assert page.snapshot().robot.title == "bent3r"


def test_a_slider_that_a_lesson_locks_shows_the_running_value_again_and_nothing_as_applied() -> None:
    page = Page()
    field = NumberField(page.desk, FieldBinding("contact.K_e"), "K_e [N/m]", log_scale(100, 100_000))
    _, text, slider = page.widgets
    field.show(page.snapshot())
    running, place = text.value, slider.value
    page.lock.fields = frozenset({"target_model.B_m"})
    page.give(slider, place - 0.2)
    page.give(text, f"{text.value}{RELEASED}")
    assert page.complaints == [
        "K_e, stiffness of the surface: locked by the goal of a lesson; allowed: B_m, or leave the lesson"
    ]
    assert page.whatif.undo(page.snapshot()) is None
    field.show(page.snapshot())
    assert (text.value, slider.value) == (running, place)
    page.lock.fields = frozenset({"contact.K_e"})
    page.give(slider, place - 0.2)
    page.give(text, f"{text.value}{RELEASED}")
    undo = page.whatif.undo(page.snapshot())
    assert undo is not None
    assert page.snapshot().scenario != shipped()["ur5-hybrid"]
    assert page.desk.post(undo)
    assert page.snapshot().scenario == shipped()["ur5-hybrid"]


@pytest.mark.parametrize("preview", [True, False], ids=["previewed", "applied at once"])
def test_a_slider_is_taken_back_by_esc_and_after_its_release(preview: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """However long it is held."""
    page, now, usual = Page(), [0.0], shipped()["ur5-hybrid"]
    monkeypatch.setattr(controls.time, "monotonic", lambda: now[0])
    page.whatif.on = preview
    field = NumberField(page.desk, FieldBinding("contact.K_e"), "K_e [N/m]", log_scale(100, 100_000))
    _, text, slider = page.widgets
    for mark in (ESCAPED, RELEASED):
        field.show(page.snapshot())
        for _ in range(2):
            page.give(slider, slider.value - 0.1)
            assert (page.snapshot().scenario == usual) == preview
        now[0] += 2.0 * controls.LONGEST if preview else 1.0
        page.give(text, f"{text.value}{mark}")
        assert (page.snapshot().scenario == usual) == (mark == ESCAPED)
    undo = page.whatif.undo(page.snapshot())
    assert undo is not None
    assert page.desk.post(undo)
    assert page.snapshot().scenario == usual


def test_an_input_stays_until_the_runner_has_answered_it_however_long_that_takes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    page, now, posted = Page(), [0.0], list[Command]()
    monkeypatch.setattr(controls.time, "monotonic", lambda: now[0])

    def queue(command: Command) -> int:
        posted.append(command)
        return page.runner._executed + len(posted)

    page.desk.post(Edit("force.value", -1.0))  # refused: of no meaning for what is asked for later
    page.lock._post = queue
    contact = Dropdown(page.desk, "contact.kind", "Contact", {"elastic": "elastic", "heavy": "mass-damper-spring"})
    menu = page.widgets[-1]
    force = NumberField(page.desk, FieldBinding("force.value"), "F_d [N]")
    text = page.widgets[-1]
    flat = Switch(page.desk, FieldBinding("face.flat"), "flat")
    box = page.widgets[-1]

    def shown(snapshot: Snapshot) -> tuple[object, object, object]:
        for control in (contact, force, flat):
            control.show(snapshot)
        return menu.value, text.value, box.value

    assert shown(page.snapshot()) == ("elastic", "20", False)
    page.give(menu, "heavy")
    page.give(text, f"25.0{ENTERED}")
    page.give(box, True)
    asked = "heavy", "25.0", True
    now[0] = 30.0
    assert shown(page.snapshot()) == asked
    for half in range(61, 400):  # the time of compiling does not count
        now[0] = 0.5 * half
        assert shown(replace(page.snapshot(), notice=PREPARING)) == asked
    page.runner._obey(posted[:2])
    assert shown(page.snapshot()) == ("heavy", "25", True)  # accepted, accepted and not answered yet
    assert page.snapshot().refusal_number == 1
    page.runner._obey([Edit("face.flat", None)])
    assert shown(page.snapshot()) == ("heavy", "25", False)  # refused
    page.give(menu, "elastic")
    now[0] += controls.LONGEST + 1.0
    assert shown(page.snapshot()) == ("heavy", "25", False)  # the loop has ended


def test_a_shift_shows_a_number_for_each_coordinate_and_says_how_many_there_are() -> None:
    for name, zeros, count, example in (
        ("ur5-hybrid", "0, 0", "two", "0.02, 0"),
        ("ur5-motion", "0, 0, 0", "three", "0.02, 0, 0"),
    ):
        page = Page()
        page.desk.post(Load(shipped()[name]))
        field = NumberField(page.desk, Shift("shift.by"), "shifted by [m]")
        text = page.widgets[-1]
        field.show(page.snapshot())
        assert text.value == zeros
        page.give(text, f"0.02{ENTERED}")
        assert page.complaints[-1] == f"shifted by [m]: 0.02; allowed: {count} numbers, such as {example}"
        page.give(text, f"{example}{ENTERED}")
        field.show(page.snapshot())
        assert text.value == example
        assert page.snapshot().refusal is None


def test_one_number_is_typed_where_one_of_a_list_is_shown() -> None:
    page = Page()
    page.desk.post(Edit("motion", {"kind": "point-to-point"}))
    field = NumberField(page.desk, FieldBinding("motion.displacement"), "by [m]")
    field.show(page.snapshot())
    page.give(page.widgets[-1], f"0.03{ENTERED}")
    assert page.snapshot().scenario.motion == edited(page.snapshot().scenario, "motion.displacement", [0.03]).motion
    assert page.snapshot().refusal is None


def test_a_scenario_that_is_chosen_begins_at_zero_and_runs() -> None:
    page = Page()
    panel = TaskPanel(page.desk)
    menu, own = page.widgets[0], shipped()["ur5-hybrid"]
    panel.show(page.snapshot())
    titles = menu.options
    page.desk.post(Pause())
    page.desk.post(StepOnce())
    page.desk.post(Edit("force.value", 25.0))
    panel.show(page.snapshot())
    # there while it is so, since to choose it would do nothing
    assert menu.value == f"{own.title}, edited"
    assert menu.options == (*titles, menu.value)
    page.desk.post(Edit("mode", "impedance"))
    panel.show(page.snapshot())
    assert menu.value == "Universal Robots UR5: impedance, plane, edited"
    assert menu.options == (*titles, menu.value)
    page.desk.post(EditAll({"name": "mine", "title": own.title}))
    panel.show(page.snapshot())
    assert menu.value == f"{own.title}, edited"
    before = page.snapshot()
    page.give(menu, own.title)
    now = page.snapshot()
    assert (now.t, now.phase, now.scenario) == (0.0, "running", own)
    assert now.run > before.run
    panel.show(now)
    assert menu.value == own.title
    assert menu.options == titles


def test_a_hint_says_the_bounds_in_words() -> None:
    assert FieldBinding("force.value").hint.endswith("; allowed: from −10000 to 10000 N")
    assert FieldBinding("contact.friction_coulomb").hint == "friction coefficient; allowed: from 0 to 2"
    assert FieldBinding("shift.duration").hint.endswith("; allowed: from 0.001 to 60 s")
    assert FieldBinding("blend.over").hint.endswith("; allowed: above 0, at most 3600 s")
    assert FieldBinding("controller.F_1").hint.endswith("[1/s]")


@pytest.mark.parametrize("ended_by", ["revert", "a page that is closed", "another run"])
def test_a_slider_whose_preview_has_ended_shows_the_running_value_and_applies_nothing(ended_by: str) -> None:
    page = Page()
    field = NumberField(page.desk, FieldBinding("contact.K_e"), "K_e [N/m]", log_scale(100, 100_000))
    _, text, slider = page.widgets
    field.show(page.snapshot())
    running, place = text.value, slider.value
    page.whatif.look(page.snapshot(), {1}, 0.0)
    page.give(slider, place - 0.2)
    if ended_by == "another run":
        page.desk.post(Reset())
    elif ended_by == "revert":
        assert page.whatif.held is not None
        page.whatif.drop(page.whatif.held)
    page.whatif.look(page.snapshot(), set() if "page" in ended_by else {1}, 0.0)
    field.show(page.snapshot())
    assert (text.value, slider.value) == (running, place)
    page.give(text, f"{text.value}{RELEASED}")
    assert page.snapshot().scenario == shipped()["ur5-hybrid"]
    assert page.whatif.undo(page.snapshot()) is None
