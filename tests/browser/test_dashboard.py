"""The page in a real browser: a person's actions, and their effect in the running loop."""

import re
import socket

import pytest
from playwright.sync_api import expect

from app.access.admission import PortTaken
from app.dashboard.page import Dashboard
from app.dashboard.theme.style import RELEASED
from app.dashboard.widgets.fields.field_binding import SliderScale, log_scale
from app.dashboard.widgets.fields.matrix_text import read_back, written
from app.dashboard.widgets.target_model.equation import lines
from app.scenario.data import shipped
from app.session.commands import Load
from app.session.snapshot import Snapshot
from drivers.pages import CHARTS, SHOWN, PageSession, fill_in, type_over

UNOPENED = (
    "panda-align", "planar2r-semicircle", "planar3r-corner", "ur5-corner-rigid", "ur5-groove-moving", "ur5-joint",
    "ur5-impedance-6d", "ur5-wave-constrained",
)  # fmt: skip


@pytest.mark.usefixtures("new_page")
def test_the_page_comes_up_and_shows_the_running_loop(session: PageSession):
    page = session.page
    page.locator("canvas[data-engine]").wait_for()
    page.get_by_text("promise holds").wait_for()
    expect(page.locator("math mtr")).to_have_count(1 + len(lines(session.now)))
    page.wait_for_function(f"{CHARTS}.some((c) => c.data?.[0]?.length > 100)")
    expect(page.locator(".uplot-container:visible")).to_have_count(4)


def test_another_scenario_and_mode(session: PageSession):
    session.choose("Scenario", shipped()["ur5-motion"].title)
    session.wait(lambda now: now.scenario.name == "ur5-motion" and now.phase == "running")
    session.choose("Mode", "Impedance")
    session.wait(lambda now: now.scenario.mode == "impedance" and now.t > 0.3)
    assert session.now.phase == "running", session.now.reason
    session.page.locator(".vs-note", has_text="The tool yields to forces").wait_for()


def test_a_number_takes_effect_on_enter_not_digit_by_digit(session: PageSession):
    session.wait(lambda now: abs(now.recording.signals(("F_c",))["F_c"][-1, 0] - 20.0) < 0.1)
    field = session.number("F_d [N]")
    fill_in(field, "")
    field.press_sequentially("35", delay=60)
    session.wait(lambda _: field.get_attribute("data-pending") is not None)
    session.page.wait_for_timeout(300)
    assert session.now.scenario.force.value == 20.0
    field.press("Enter")
    session.wait(lambda now: now.scenario.force.value == 35.0)
    session.wait(lambda now: abs(now.recording.signals(("F_c",))["F_c"][-1, 0] - 35.0) < 0.1)


def test_a_number_takes_effect_when_its_field_is_left(session: PageSession):
    field = session.number("F_d [N]")
    fill_in(field, "12.5")
    field.blur()
    session.wait(lambda now: now.scenario.force.value == 12.5)
    fill_in(field, "99")
    field.press("Escape")
    session.page.wait_for_timeout(400)
    assert session.now.scenario.force.value == 12.5


@pytest.mark.usefixtures("messages_stay")
def test_a_held_slider_previews_and_let_go_it_applies(session: PageSession):
    before = session.now
    move, text = session.grip("F_d [N]")
    move(0.75)
    session.moved()
    session.page.get_by_text("let go: apply").wait_for()
    ((_, place),) = session.rows("F_d [N]")
    asked = SliderScale(0.0, 60.0).value(place)
    assert 40.0 < asked < 50.0
    expect(text).to_have_value(written(asked))  # once the last position has gone and come back
    session.wait(lambda _: session.ahead() > 2.5)  # 5 s from when it was asked for, which a busy machine makes long ago
    forces = f"{SHOWN}[1]"
    foreseen = f"Math.abs({forces}?.data[2]?.at(-1) - {asked}) < 0.1"
    session.page.wait_for_function(f"{foreseen} && {forces}.scales.x.min === -8 && {forces}.scales.x.max === 5")
    assert session.now.scenario == before.scenario
    assert session.now.revision == before.revision
    session.page.mouse.up()
    session.wait(lambda now: now.scenario.force.value == asked)
    assert session.now.revision == before.revision + 1
    session.page.get_by_role("button", name="Revert").click()
    session.wait(lambda now: now.scenario == before.scenario)
    session.wait(lambda _: session.ahead() <= 1e-9)
    session.page.get_by_text("let go: apply").wait_for(state="hidden")


def test_escape_takes_a_held_slider_back(session: PageSession):
    before = session.now
    move, text = session.grip("F_d [N]")
    move(0.9)
    session.wait(lambda _: session.ahead() > 0.0)
    session.page.keyboard.press("Escape")
    session.wait(lambda _: session.ahead() <= 1e-9)
    move(0.6)
    session.page.mouse.up()
    session.page.wait_for_timeout(500)
    assert session.now.revision == before.revision
    expect(text).to_have_value("20")
    thumb = session.row("F_d [N]").get_by_role("slider")
    session.wait(lambda _: abs(float(thumb.get_attribute("aria-valuenow") or "nan") - 20.0 / 60.0) < 2e-3)


# how far apart the least and the largest of the last line's band are at the right end of the first plot of a force
_SPREAD = f"""() => {{
  const chart = {SHOWN}[1], [upper, lower] = chart?.bands[0]?.series ?? [];
  return chart?.data[upper]?.at(-1) - chart?.data[lower]?.at(-1);
}}"""


def test_true_arms_of_the_declared_set_stand_behind_a_preview(session: PageSession):
    session.page.get_by_role("button", name="play / pause").click()
    session.wait(lambda now: now.phase == "paused")
    move, _ = session.grip("F_d [N]")
    move(0.9)
    session.page.locator(".vs-held", has_text="16 true arms of the declared set").wait_for()
    session.wait(lambda _: session.page.evaluate(_SPREAD) > 0.0)
    session.page.keyboard.press("Escape")
    session.page.mouse.up()
    session.wait(lambda _: session.page.evaluate(_SPREAD) == 0.0)


def test_arrow_keys_move_a_slider_and_not_the_run(session: PageSession):
    thumb = session.row("F_d [N]").get_by_role("slider")
    thumb.focus()
    thumb.press("ArrowRight")
    session.wait(lambda now: 20.0 < now.scenario.force.value < 20.5)
    thumb.press("End")
    session.wait(lambda now: now.scenario.force.value == 60.0)
    assert session.now.phase == "running"


def test_marks_that_a_slow_server_has_not_taken_off_do_not_count_for_the_next_turn(session: PageSession):
    """The server tells one turn from the next by whether the number of marks is even or odd."""
    turn = """(input, mark) => {
      input.dispatchEvent(new CustomEvent("vsmrc-mark", { bubbles: true, detail: mark }));
      return input.value.split(mark).length - 1;
    }"""
    three = f"(input, mark) => [0, 1, 2].map(() => ({turn})(input, mark))"
    marks = session.number("F_d [N]").evaluate(three, RELEASED)
    assert sorted(marks) in ([1, 1, 2], [1, 2, 2])
    assert marks[0] != marks[1] != marks[2]


def test_a_preview_that_cannot_be_says_why_and_the_run_goes_on(session: PageSession):
    before = session.now
    session.tab("Model")
    session.tab("K_m")
    move, _ = session.grip("K_m ψ₁", at=0.7)
    move(-0.1)
    session.page.locator(".vs-held .vs-message", has_text="K_m of the free coordinates").wait_for()
    session.wait(lambda _: session.ahead() <= 1e-9)  # plots follow the message when their turn comes
    session.page.keyboard.press("Escape")
    session.page.mouse.up()
    session.wait(lambda now: now.t > before.t + 0.5)
    assert (session.now.revision, session.now.refusal_number) == (before.revision, before.refusal_number)
    assert session.now.phase == "running"


def test_without_previews_a_slider_acts_at_once(session: PageSession):
    folder = session.page.get_by_text("What if", exact=True).first
    folder.click()
    previews = session.page.get_by_role("checkbox", name="Preview")
    ahead = session.page.get_by_text("Ahead [s]", exact=True)
    ahead.wait_for()
    previews.click()
    ahead.wait_for(state="hidden")  # the server has heard of it, before viser's one slot takes what the slider says
    session.sent()
    try:
        move, text = session.grip("F_d [N]")
        move(0.75)
        session.wait(lambda now: 40.0 < now.scenario.force.value < 50.0)
        session.wait(lambda _: session.ahead() <= 1e-9)  # nan as long as no plot is drawn
        session.page.mouse.up()

        def reached(now: Snapshot) -> bool:
            """The last of the slider's values may still be on its way: all is asked of the same snapshot."""
            wanted = now.scenario.force.value
            pressed = now.recording.signals(("F_c",))["F_c"][-1, 0]
            return text.input_value() == written(wanted) and abs(pressed - wanted) < 0.1

        session.wait(reached)
        session.page.locator("form[data-held]").wait_for(state="detached")
        session.sent()  # of several inputs at once viser's client sends the last one only
    finally:
        previews.click()
        ahead.wait_for()
        folder.click()


def test_an_invalid_gain_shows_its_reason_and_the_run_goes_on(session: PageSession):
    session.tab("Model")
    before = session.now
    field = session.number("M_m φ")
    type_over(field, "0")
    session.wait(lambda now: now.refusal_number == before.refusal_number + 1)
    session.page.locator(".vs-message", has_text="M_m").wait_for()
    expect(field).to_have_value(written(before.matrices["M_m"][0, 0]))
    assert session.now.revision == before.revision
    session.wait(lambda now: now.phase == "running" and now.t > before.t)


def test_a_surface_too_stiff_is_refused_with_its_remedy_which_helps(session: PageSession):
    session.runner.post(Load(shipped()["planar3r-hybrid"]))
    session.wait(lambda now: now.scenario.name == "planar3r-hybrid")
    session.tab("World")
    session.enter("K_e [N/m]", "1e7")
    message = session.page.locator(".vs-message", has_text="too stiff").inner_text()
    enough = re.search(r"steps per period >= (\d+)", message)
    assert enough is not None
    session.enter("substeps", enough[1])
    session.wait(lambda now: now.scenario.simulation.substeps == int(enough[1]))
    session.enter("K_e [N/m]", "1e7")
    session.wait(lambda now: now.scenario.contact.K_e == 1e7)


def test_text_that_is_no_number_is_refused_on_the_page(session: PageSession):
    before = session.now
    field = session.number("F_d [N]")
    type_over(field, "<b>twenty</b>")
    session.page.locator(".vs-message", has_text="<b>twenty</b>").wait_for()
    expect(field).to_have_value("20")
    assert session.now.revision == before.revision


def test_pause_and_step(session: PageSession):
    session.page.get_by_role("button", name="play / pause").click()
    session.wait(lambda now: now.phase == "paused")
    t = session.now.t
    session.page.get_by_role("button", name="step").click()
    session.wait(lambda now: now.t > t)
    assert session.now.t == pytest.approx(t + session.now.scenario.controller.period)
    session.page.get_by_role("button", name="reset").click()
    session.wait(lambda now: now.t < t)


def test_looking_at_every_tab_changes_nothing(session: PageSession):
    before = session.now
    for name in ("Model", "Controller", "World", "Robot", "Export", "Torque", "Task"):
        session.tab(name)
        session.page.wait_for_timeout(300)
    assert session.now.revision == before.revision
    assert session.now.scenario == before.scenario
    assert session.now.refusal_number == before.refusal_number


def test_scenarios_that_no_other_test_opens_can_be_shown(session: PageSession):
    """Those of the shipped ones that are different code; tests/dashboard draws each of them without a browser."""
    for name in UNOPENED:
        scenario = shipped()[name]
        session.runner.post(Load(scenario))
        session.wait(lambda now, name=name: now.scenario.name == name and now.t > 0.2)
        session.page.locator(".vs-title", has_text=scenario.title).wait_for()


def test_law_and_push_are_two_large_buttons_in_the_scene(session: PageSession):
    page, began = session.page, session.now.run
    buttons = page.locator(".vs-acts button")
    expect(buttons).to_have_count(2)
    swap, push = buttons.all()
    page.wait_for_function("""() => {
      const boxes = [...document.querySelectorAll(".vs-acts button")].map((e) => e.getBoundingClientRect());
      const scene = document.querySelector("canvas[data-engine]").getBoundingClientRect();
      return boxes.length === 2
        && boxes.every((b) => b.height >= 44 && scene.left <= b.left && b.right <= scene.right);
    }""")
    swap.click()
    session.wait(lambda now: now.scenario.controller.law == "computed-torque")
    page.get_by_role("button", name="Try robust (25)").wait_for()
    page.keyboard.press("l")
    session.wait(lambda now: now.scenario.controller.law == "vsmrc")
    push.click()
    session.wait(lambda now: bool(now.recording.signals(("F_push",))["F_push"].any()))
    assert session.now.run == began  # neither begins the run anew


def test_from_an_impedance_every_mode_key_leads_on_and_says_what_it_adapted(session: PageSession):
    page, impedance = session.page, shipped()["ur5-impedance"]
    for key, mode in (("3", "hybrid"), ("4", "hybrid-impedance"), ("5", "constrained")):
        session.runner.post(Load(impedance))
        session.wait(lambda now: now.scenario == impedance)
        page.keyboard.press(key)
        session.wait(lambda now, mode=mode: now.scenario.mode == mode and now.phase == "running")
        page.locator(".vs-strip").get_by_text("Adapted: path by 0.1, −0.05").wait_for()


def test_a_busy_port_is_said():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(PortTaken, match=str(other.getsockname()[1])):
            Dashboard(port=other.getsockname()[1])


@pytest.mark.parametrize("scale", [SliderScale(0, 60), log_scale(0.1, 100), log_scale(1, 1e5, zero=True)])
def test_slider_positions_and_values_are_inverse(scale: SliderScale):
    for position in (0.1, 0.37, 0.5, 1.0):
        assert scale.position(scale.value(position)) == pytest.approx(position, abs=0.003)
    assert scale.value(0.0) == (0.0 if scale.zero else scale.low)
    assert scale.position(-1.0) == 0.0
    assert scale.position(1e12) == 1.0


def test_numbers_are_written_and_read_back():
    assert read_back(written(0.01)) == 0.01
    assert read_back(written((0.1, 0.0, -2.5))) == [0.1, 0.0, -2.5]
    assert isinstance(read_back(written(4)), int)
    with pytest.raises(ValueError, match="twenty"):
        read_back("twenty")
