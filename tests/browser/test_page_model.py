"""Equation, target model and controller on the page: what a person edits, and its effect in the running loop."""

import numpy as np
import pytest
from playwright.sync_api import TimeoutError, expect

from app.dashboard.widgets.fields.field_binding import FINE_STEP, SliderScale
from app.session.commands import Pause, Play, StepOnce
from app.session.snapshot import Snapshot
from drivers.pages import PageSession, fill_in, resting_box

COUPLED = "0 0 0 0 0 0\n0 4000 900 0 0 0\n0 900 4000 0 0 0\n0 0 0 4000 0 0\n0 0 0 0 4000 0\n0 0 0 0 0 4000"

# Script that notes the places of a slider from now on.
NOTE_PLACES = """(thumb) => {
  window.places = [];
  const note = () => window.places.push(+thumb.ariaValueNow);
  new MutationObserver(note).observe(thumb, { attributeFilter: ["aria-valuenow"] });
}"""

# Whether one of them is a whole number of steps from the left end, as each is that a key has led to.
STEPPED = "(step) => window.places.some((place) => Math.abs(place / step - Math.round(place / step)) < 5e-7)"


def test_omega_dragged_and_typed_sets_damping_and_stiffness(session: PageSession):
    before = session.now.matrices
    session.tab("Model")
    session.choose("Edit by", "ω and ζ per axis")
    session.enter("ω ψ₁", "30")
    session.wait(lambda now: now.matrices["K_m"][1, 1] == 9000.0)
    np.testing.assert_allclose(session.now.matrices["B_m"][1, 1], 600.0)
    np.testing.assert_array_equal(session.now.matrices["M_m"], before["M_m"])
    move, _ = session.grip("ω ψ₂", at=0.56)

    def shown() -> float:
        ((text, _),) = session.rows("ω ψ₂")
        return float(text or "nan")

    move(0.75)
    session.page.locator(".vs-poles .asked").first.wait_for()
    assert session.now.matrices["K_m"][2, 2] == before["K_m"][2, 2]
    session.page.mouse.up()
    session.wait(lambda now: now.matrices["K_m"][2, 2] != before["K_m"][2, 2])
    session.wait(lambda now: abs(now.matrices["K_m"][2, 2] - 10.0 * shown() ** 2) < 1e-6)
    np.testing.assert_allclose(session.now.matrices["B_m"][2, 2], 20.0 * shown())
    session.enter("ω ψ₁", "-2")
    session.page.locator(".vs-message", has_text="ω ψ₁: -2; allowed: a number > 0").wait_for()
    session.choose("Edit by", "diagonals")
    assert session.now.phase == "running"


def test_whole_matrices_are_pasted_judged_and_applied(session: PageSession):
    session.tab("Model")
    session.choose("Edit by", "full matrices")
    before = session.now
    page = session.page
    paste = page.locator("textarea:visible")
    fill_in(paste, COUPLED)
    page.get_by_text("K_m: not applied yet.").wait_for()
    assert session.now.revision == before.revision
    page.get_by_role("button", name="apply all").click()
    session.wait(lambda now: now.matrices["K_m"][1, 2] == now.matrices["K_m"][2, 1] == 900.0)
    page.locator(".vs-block").first.wait_for()

    fill_in(paste, COUPLED.replace("900", "5000"))
    page.get_by_text("asked: not stable").wait_for()
    refused = session.now.refusal_number
    page.get_by_role("button", name="apply all").click()
    session.wait(lambda now: now.refusal_number == refused + 1)
    page.locator(".vs-status", has_text="K_m of the free coordinates: smallest eigenvalue -1000").wait_for()
    page.get_by_role("button", name="discard").click()
    page.get_by_text("asked: not stable").wait_for(state="detached")
    cell = page.locator(".mantine-NumberInput-input:visible").nth(5)  # row ψ₁, column ψ₂
    fill_in(cell, "700")
    page.get_by_role("button", name="apply all").click()
    session.wait(lambda now: now.matrices["K_m"][1, 2] == now.matrices["K_m"][2, 1] == 700.0)
    t = session.now.t
    session.wait(lambda now: now.t > t + 0.3)
    assert session.now.phase == "running"
    session.choose("Edit by", "diagonals")


def test_the_controller_as_far_as_it_has_a_meaning(session: PageSession):
    session.tab("Controller")
    page = session.page
    session.choose("Switching", "s / ‖s‖ (discontinuous)")
    session.wait(lambda now: now.scenario.controller.switching == "discontinuous")
    session.row("layer s_b [m/s]").wait_for(state="detached")
    expect(session.row("constant d [N]")).to_have_count(0)
    session.choose("Gain d", "constant")
    session.enter("constant d [N]", "40")
    session.wait(lambda now: (now.scenario.controller.d, now.live["d"]) == (40.0, 40.0))
    session.enter("K_s [N·s/m]", "100, 100, 100, 50, 50, 50")
    session.wait(lambda now: now.scenario.controller.K_s == (100.0, 100.0, 100.0, 50.0, 50.0, 50.0))
    session.row("K_s [N·s/m]").locator(".mantine-Slider-root").wait_for(state="detached")
    session.enter("K_s [N·s/m]", "100, 50")
    page.locator(".vs-status", has_text="reaching gain K_s: 2 entries; allowed: 6 diagonal entries").wait_for()
    session.choose("Law", "computed torque")
    session.wait(lambda now: now.scenario.controller.law == "computed-torque")
    page.get_by_text("Computed torque, the baseline").wait_for()
    session.row("K_s [N·s/m]").wait_for(state="detached")
    assert session.now.phase == "running"


def test_another_model_is_reached_by_a_blend(session: PageSession):
    session.tab("Model")
    session.choose("Edit by", "full matrices")
    page = session.page
    fill_in(page.locator("textarea:visible"), COUPLED)
    page.get_by_text("K_m: not applied yet.").wait_for()
    fill_in(page.get_by_role("textbox", name="blend over [s]"), "1.5")
    page.get_by_text("blend: certified by eigenvalues").wait_for()
    session.runner.post(Pause())  # within the blend, however long the page takes
    page.get_by_role("button", name="apply all").click()
    session.wait(lambda now: now.scenario.blend.to.K_m is not None)
    for _ in range(3):  # it begins with the first one, and the law follows at the next
        session.runner.post(StepOnce())
    session.wait(lambda now: now.blending is not None and 0.0 < now.matrices["K_m"][1, 2] < 900.0)
    page.get_by_text("blending:").wait_for()
    session.runner.post(Play())
    session.wait(lambda now: now.blending is None and now.matrices["K_m"][1, 2] == 900.0)
    assert session.now.scenario.blend.to.K_m is None
    assert session.now.phase == "running"
    session.choose("Edit by", "diagonals")


def test_the_simplest_baseline_with_weak_drives(session: PageSession):
    session.tab("Controller")
    session.choose("Law", "PD + gravity")
    session.wait(lambda now: now.scenario.controller.law == "pd-gravity" and now.live["d"] == 0.0)
    session.page.get_by_text("PD + gravity, the simplest baseline").wait_for()
    session.tab("Robot")
    session.enter("torque limit ×", "0.05")
    session.wait(lambda now: now.scenario.truth.torque_limit == 0.05)
    session.page.locator(".vs-status", has_text="torque at its limit: joint").wait_for()


def test_with_shift_a_slider_moves_a_tenth_as_far_by_mouse_and_key(session: PageSession):
    page, slider, scale = session.page, session.row("F_d [N]").get_by_role("slider"), SliderScale(0.0, 60.0)

    def at() -> float:
        return float(slider.get_attribute("aria-valuenow") or "nan")

    def reaches(expected: float) -> None:
        near = "(x) => Math.abs(document.querySelector('form[data-held] [role=slider]').ariaValueNow - x) < 0.01"
        page.wait_for_function(near, arg=expected)

    boxes = [session.row("F_d [N]").locator(f".mantine-Slider-{part}").bounding_box() for part in ("root", "track")]
    root, track = (box["width"] for box in boxes if box is not None)
    move, _ = session.grip("F_d [N]", 0.5)
    reaches(0.5)
    move(0.7)
    reaches(0.5 + 0.2 * root / track)
    page.keyboard.down("Shift")
    move(0.9)
    reaches(0.5 + 0.22 * root / track)
    page.keyboard.up("Shift")
    page.mouse.up()
    session.wait(lambda now: now.scenario.force.value == float(f"{60.0 * at():.4g}"))
    page.locator("form[data-held]").wait_for(state="detached")

    def step_by(keys: tuple[str, ...], step: float) -> float:
        """Hold the keys; returns the place before. Again where a late answer to what was before has taken the step back
        in the same picture: then the slider is seen at no whole step."""
        for _ in range(5):
            # in its place once the answer, of three or four digits, has come
            session.wait(lambda now: abs(scale.position(now.scenario.force.value) - at()) <= 0.6 * FINE_STEP)
            before = at()
            slider.focus()
            slider.evaluate(NOTE_PLACES)
            for key in keys:
                page.keyboard.down(key)
            try:
                page.wait_for_function(STEPPED, arg=step, timeout=20e3)
            except TimeoutError:
                let_go(keys)
            else:
                return before
        raise AssertionError(f"{keys} move the slider by no whole step")

    def let_go(keys: tuple[str, ...]) -> None:
        for key in reversed(keys):
            page.keyboard.up(key)
        page.locator("form[data-held]").wait_for(state="detached")

    for keys, step in (("ArrowLeft",), 0.002), (("Shift", "ArrowLeft"), 0.0002), (("Shift", "ArrowUp"), 0.0002):
        before = step_by(keys, step)
        # a rounded answer to the key before may still move it by less than a step, before or after the key
        places: list[float] = page.evaluate("window.places")
        stepped = [place for place in places if round(place / step, 6).is_integer()]
        assert abs(stepped[-1] - before) <= 1.5 * step + 1e-9
        assert (stepped[-1] > before) == (keys[-1] == "ArrowUp")
        let_go(keys)


def test_linked_axes_move_together(session: PageSession):
    session.tab("Model")
    session.check("Link equal axes")
    session.tab("K_m")
    session.enter("K_m ψ₁", "3000")
    session.wait(lambda now: now.matrices["K_m"].diagonal().tolist() == [0.0, 3000.0, 3000.0, 4000.0, 4000.0, 4000.0])
    session.check("Link equal axes", on=False)


def test_linked_sliders_follow_the_one_that_is_held_and_go_back_with_it(session: PageSession):
    page, before = session.page, session.now

    def together() -> tuple[str, float] | None:
        """Text and place that both sliders have."""
        (one, here), (other, there) = session.rows("K_m ψ₁", "K_m ψ₂")
        return (one, here) if one == other != "4000" and abs(here - there) < 2e-3 else None  # a text has three digits

    session.tab("Model")
    session.check("Link equal axes")
    session.tab("K_m")
    session.wait(lambda _: session.rows("K_m ψ₂")[0][0] == "4000")
    alone = session.rows("K_m φ", "K_m ℓ·α")
    move, _ = session.grip("K_m ψ₁", at=0.7)
    for fraction in (0.8, 0.55):
        move(fraction)
        session.moved()
        session.wait(lambda _: together() is not None)
        found = together()
        page.wait_for_timeout(400)
        assert found is not None
        assert together() == (found[0], pytest.approx(found[1], abs=2e-3))  # it stays where it is held
        assert abs(found[1] - fraction) < 0.03
    assert session.rows("K_m φ", "K_m ℓ·α") == alone
    assert session.now.revision == before.revision
    page.keyboard.press("Escape")
    session.wait(lambda _: [text for text, _ in session.rows("K_m ψ₁", "K_m ψ₂")] == ["4000", "4000"])
    page.mouse.up()
    page.locator("form[data-held]").wait_for(state="detached")

    move, _ = session.grip("K_m ψ₂", at=0.7)
    move(0.6)
    session.moved()
    session.wait(lambda _: together() is not None)
    page.mouse.up()
    session.wait(lambda now: now.revision == before.revision + 1)

    def applied(now: Snapshot) -> bool:
        stiffness = float(session.rows("K_m ψ₂")[0][0] or "nan")
        return now.matrices["K_m"].diagonal().tolist() == [0.0, stiffness, stiffness, 4000.0, 4000.0, 4000.0]

    session.wait(applied)
    page.wait_for_timeout(1500)  # longer than a control waits for an answer
    assert session.now.revision == before.revision + 1
    session.check("Link equal axes", on=False)


def test_a_pole_dragged_on_the_map_is_previewed_then_applied_and_esc_leaves_it(session: PageSession):
    page = session.page
    session.tab("Model")
    before = session.now.matrices["K_m"].copy()
    mark = page.locator(".vs-poles [data-pole] .grip").first
    asked = page.locator(".vs-poles .asked").first

    def take_to(dx: float, dy: float) -> None:
        for _ in range(5):  # the map moves while the tab is laid out, and is sent anew
            mark.scroll_into_view_if_needed()
            box = resting_box(mark)
            x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
            page.mouse.move(x, y)
            page.mouse.down()
            page.mouse.move(x + dx, y + dy, steps=5)
            try:
                asked.wait_for(timeout=20e3)
            except TimeoutError:
                page.mouse.up()
            else:
                return
        raise AssertionError("the pole cannot be taken")

    take_to(30.0, -40.0)
    assert (session.now.matrices["K_m"] == before).all()
    page.keyboard.press("Escape")
    page.mouse.up()
    asked.wait_for(state="detached")
    assert (session.now.matrices["K_m"] == before).all()

    take_to(30.0, -40.0)
    page.mouse.up()
    session.wait(lambda now: (now.matrices["K_m"] != before).any())
    now = session.now.matrices
    np.testing.assert_array_equal(now["M_m"], np.diag([10.0] * 6))
    changed = np.flatnonzero(np.diag(now["K_m"]) != np.diag(before))
    zeta = np.diag(now["B_m"])[changed] / (2.0 * np.sqrt(10.0 * np.diag(now["K_m"])[changed]))
    assert (zeta < 0.9).all()  # it was critically damped, and has left the real axis
    assert session.now.phase == "running"


def test_a_push_measures_the_impedance_beside_the_running_loop(session: PageSession):
    """Dots appear over the lines, and go with the next change of the scenario."""
    session.tab("Model")
    page = session.page
    page.get_by_text("force loop, delay margin").wait_for()  # the force loop's margins
    before = session.now
    page.get_by_role("button", name="Measure with a push").click()
    page.locator("circle.measured").first.wait_for()
    page.get_by_text("dots: a chirp of 2 N").wait_for()
    assert session.now.revision == before.revision
    with page.expect_download() as download:
        page.get_by_role("radio", name="CSV", exact=True).or_(
            page.get_by_role("button", name="CSV", exact=True)
        ).click()
    with open(download.value.path(), encoding="utf-8") as file:
        assert sum(line.startswith("measured,") for line in file) == 14
    session.choose("Edit by", "ω and ζ per axis")
    session.enter("ω ψ₁", "30")
    page.locator("circle.measured").first.wait_for(state="detached")
    session.choose("Edit by", "diagonals")
