"""The World tab's typed surface in a real browser."""

import numpy as np
from playwright.sync_api import expect

from app.scenario.data import shipped
from app.session.commands import Load
from drivers.pages import PageSession, fill_in, type_over

RUNNING = "z - 0.165 - 0.01*sin(20*x - 2*t)"


def test_a_formula_is_typed_refused_mended_and_pressed_upon(session: PageSession):
    session.tab("World")
    session.choose("Shape", "formula")
    session.wait(lambda now: now.scenario.surface.__struct_config__.tag == "formula" and now.t > 0.2)
    before, field = session.now, session.row("0 =").locator("input")
    fill_in(field, "z - 0.165 - 0.01*sine(8*x - 2*t)")
    assert session.now.scenario == before.scenario
    field.press("Enter")
    session.page.get_by_text('formula of the surface: "sine" at character 18 is unknown').first.wait_for()
    session.wait(lambda now: now.t > before.t + 0.5)
    assert session.now.scenario == before.scenario
    assert session.now.run == before.run
    session.page.wait_for_timeout(500)
    assert "sine" in field.input_value()  # to be mended
    type_over(field, "z - 0.165 - 0.01*sin(8*x - 2*t)")
    session.wait(lambda now: now.scenario.surface.text.startswith("z - 0.165 - 0.01*sin("))
    session.wait(lambda now: now.t > 2.0 and abs(np.linalg.norm(now.force) - 20.0) < 0.5)
    assert session.now.phase == "running"
    fill_in(field, "")
    field.press("Escape")
    session.wait(lambda now: field.input_value() == now.scenario.surface.text)


def test_controls_without_meaning_are_hidden_and_the_side_turns_the_force(session: PageSession):
    session.runner.post(Load(shipped()["ur5-wave"]))
    session.wait(lambda now: now.scenario.name == "ur5-wave" and now.force[2] < -15.0)
    session.tab("World")
    expect(session.row("0 =").locator("input")).to_have_value(RUNNING)
    expect(session.number("normal")).to_be_visible()
    for hidden in ("radius [m]", "axis", "M_e [kg]"):
        session.number(hidden).wait_for(state="hidden")
    session.choose("Solid", "where the formula > 0")
    session.wait(lambda now: now.scenario.surface.solid == "above" and now.force[2] > 15.0)
    session.choose("Shape", "cylinder")
    session.number("axis").wait_for()
    session.row("0 =").wait_for(state="hidden")
    session.wait(lambda now: now.t > 1.0 and now.phase == "running")
