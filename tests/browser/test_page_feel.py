"""The page as a whole in a real browser: keys, themes, a phone, first steps, and nothing cut or covered."""

import re

import pytest
from playwright.sync_api import Locator, Page, expect

from app.dashboard.panels.tabs import PANELS
from app.dashboard.widgets.page.help import KEYS
from app.lessons.lesson import shipped_lessons
from app.scenario.data import shipped
from app.session.commands import Edit, Pause, Play
from controllers.modes import MODES
from drivers.pages import CHARTS, PageSession, fill_in, resting_box, wait_without_notice
from tests.support.layout import lasting_faults

_THEME = "document.documentElement.dataset.mantineColorScheme"
# the equation's window leaves the docks free
EQUATION = "document.querySelector('[data-floating-window]:has(.vs-equation)')"
WITHIN = """() => {
  const box = (part) => document.querySelector(part)?.getBoundingClientRect();
  const scene = box("canvas[data-engine]"), model = box("[data-floating-window]:has(.vs-equation)");
  if (!scene || !model) return false;
  const seen = document.querySelector(".vs-equation").checkVisibility({ visibilityProperty: true });
  if (scene.width < 180 || innerHeight <= 560) return !seen; // no room for it
  return scene.left - 1 <= model.left && model.right <= scene.right + 1;
}"""

# what has the focus when a click is over, before the next picture is drawn
_NOTE_FOCUS = """() => addEventListener("click", () => { window.focusAfterClick = document.activeElement.tagName; },
  { once: true })"""


def test_keys_act_in_the_loop_but_not_while_typing(session: PageSession):
    page = session.page
    page.keyboard.press("2")
    session.wait(lambda now: now.scenario.mode == "impedance")
    page.keyboard.press("3")
    session.wait(lambda now: now.scenario.mode == "hybrid")
    page.locator(".vs-mode", has_text=MODES["hybrid"].label).wait_for()

    before = session.now
    text = session.number("radius [m]")
    fill_in(text, "")
    text.press_sequentially("1 R t h ?", delay=30)
    text.press("Escape")
    page.wait_for_timeout(500)
    assert session.now.scenario.mode == "hybrid"
    assert (session.now.run, session.now.phase, session.now.revision) == (before.run, "running", before.revision)
    assert page.evaluate(_THEME) == "dark"
    assert not page.locator(".vs-help").count()
    text.blur()

    # a button that was clicked does not keep the space key, and one that is reached by Tab has it alone
    button = page.get_by_role("button", name="play / pause")
    page.evaluate(_NOTE_FOCUS)
    button.click()
    session.wait(lambda now: now.phase == "paused")
    assert page.evaluate("window.focusAfterClick") == "BODY"
    page.keyboard.press("Space")
    session.wait(lambda now: now.phase == "running")
    button.focus()
    page.keyboard.press("Space")
    session.wait(lambda now: now.phase == "paused")
    page.wait_for_timeout(500)
    assert session.now.phase == "paused"
    button.blur()

    text.focus()
    page.keyboard.press("Control+k")  # also from a text field
    expect(page.get_by_placeholder("Search commands")).to_be_focused()
    page.keyboard.press("Escape")
    expect(page.get_by_placeholder("Search commands")).to_have_count(0)

    explain = page.locator(".vs-tools [data-key=h]")
    explain.focus()
    page.keyboard.press("Enter")
    page.locator(".vs-help").wait_for()
    page.keyboard.press("Escape")
    page.locator(".vs-help").wait_for(state="detached")
    expect(explain).to_be_focused()
    explain.blur()

    page.keyboard.press("?")
    page.locator(".vs-help").wait_for()
    run = session.now.run
    page.keyboard.press("r")
    page.wait_for_timeout(300)
    assert session.now.run == run
    page.keyboard.press("Escape")
    page.locator(".vs-help").wait_for(state="detached")

    # the guided minute can be begun without a key, as on a phone, and the help makes room for it
    minute = page.get_by_role("button", name="A guided minute", exact=True)
    for opened in (True, False):
        page.keyboard.press("?")
        page.locator(".vs-help [data-key=g]").click()
        page.locator(".vs-help").wait_for(state="detached")
        expect(minute).to_have_count(1 if opened else 0)

    page.keyboard.press("Control+k")
    palette = page.locator(".mantine-Spotlight-action")
    palette.first.wait_for()

    def listed() -> set[str]:
        shown = [re.search(r"\n\s*(\S+)$", entry.strip()) for entry in palette.all_inner_texts()]
        return {match[1] for match in shown if match}

    written = {"arrowleft": "←", "arrowright": "→", "pageup": "PgUp", "pagedown": "PgDn", "end": "End"}
    keys = {re.sub("[a-z]+$", lambda name: written.get(name[0], name[0]), key) for key in KEYS}
    session.wait(lambda _: listed() == keys | set(shipped()))
    for title in PANELS:
        page.get_by_placeholder("Search commands").fill(title)
        expect(palette.first.locator(".mantine-Spotlight-actionLabel")).to_have_text(f"Controls: {title}")
    for part, title in {"desired force": "Task", "damping": "Model", "friction": "World", "URDF": "Robot"}.items():
        page.get_by_placeholder("Search commands").fill(part)
        expect(palette.first.locator(".mantine-Spotlight-actionLabel")).to_have_text(f"Controls: {title}")

    def choose(command: str) -> None:
        page.get_by_placeholder("Search commands").fill(command)
        palette.filter(has_text=command).click()
        expect(page.get_by_placeholder("Search commands")).to_have_count(0)

    choose(shipped()["ur5-impedance"].title)
    session.wait(lambda now: now.scenario.name == "ur5-impedance")
    page.keyboard.press("Control+k")
    choose("Controls: World")
    expect(page.get_by_role("tab", name="World", exact=True)).to_have_attribute("aria-selected", "true")
    expect(page.get_by_role("tab", name="World", exact=True)).to_be_focused()
    page.keyboard.press("Control+k")
    choose(shipped_lessons()["03-wall"].head.title)
    expect(page.get_by_role("tab", name="Lessons", exact=True)).to_have_attribute("aria-selected", "true")
    page.locator(".vs-lesson[data-step='1']").wait_for()
    page.get_by_role("button", name="Leave the lesson").click()  # all tests of this page share it
    page.locator(".vs-lesson[data-step]").wait_for(state="detached")

    # "h" would open the help, had the palette not been called just before
    page.evaluate(
        """() => [{ key: "k", code: "KeyK", ctrlKey: true }, { key: "h", code: "KeyH" }].forEach((key) =>
          document.body.dispatchEvent(new KeyboardEvent("keydown", { ...key, bubbles: true, cancelable: true })))"""
    )
    expect(page.get_by_placeholder("Search commands")).to_have_value("h")
    expect(page.locator(".vs-help")).to_have_count(0)
    page.keyboard.press("Escape")
    expect(page.get_by_placeholder("Search commands")).to_have_count(0)


@pytest.mark.usefixtures("from_the_start")
def test_a_phone_shows_status_buttons_and_a_plot(served, open_page):
    dashboard, _ = served
    page = open_page(
        dashboard.url, viewport={"width": 390, "height": 844}, is_mobile=True, has_touch=True, device_scale_factor=2
    )
    page.get_by_text("real time").wait_for()
    page.locator(".uplot-container canvas").first.wait_for()
    page.wait_for_function("document.documentElement.scrollWidth === 390")
    for part in (".vs-status", "canvas[data-engine]"):
        # in one call: what is drawn again ten times a second may be gone in the next
        page.wait_for_function(
            """(part) => {
              const box = document.querySelector(part)?.getBoundingClientRect();
              return box && box.left >= 0 && box.right <= 390 && box.bottom <= 844;
            }""",
            arg=part,
        )
    # a plot that can be read is in sight with its legend, between the status and the lower edge
    page.locator(".uplot-container:visible").first.scroll_into_view_if_needed()
    page.wait_for_function(
        """() => {
          const plot = document.querySelector(".uplot-container"), box = plot.getBoundingClientRect();
          return plot.querySelector(".u-over").offsetHeight >= 180 && box.bottom <= 844
            && box.top >= document.querySelector(".vs-status").getBoundingClientRect().bottom;
        }"""
    )
    # the ticks of the timeline scroll away under the status, which stays in sight
    layers = "(parts) => parts.map((part) => Number(getComputedStyle(document.querySelector(part)).zIndex))"
    status, ticks = page.evaluate(layers, ["div:has(> .vs-status)", ".vs-ticks"])
    assert ticks < status
    # the tabs of a phone are other elements than those beside the scene
    page.keyboard.press("Control+k")
    page.get_by_placeholder("Search commands").fill("Controls: World")
    page.locator(".mantine-Spotlight-action", has_text="Controls: World").tap()
    expect(page.get_by_role("tab", name="World", exact=True)).to_have_attribute("aria-selected", "true")
    page.get_by_role("button", name="play / pause").tap()
    page.locator(".vs-chip", has_text="paused").wait_for()


@pytest.mark.usefixtures("from_the_start")
def test_first_steps_come_once_and_a_reload_in_the_middle_of_a_run_is_harmless(served, open_page):
    dashboard, runner = served
    page = open_page(dashboard.url, first_visit=True, viewport={"width": 1280, "height": 720})
    page.get_by_text("real time").wait_for()
    page.locator(".vs-hints").wait_for()
    wait_without_notice(page)
    assert lasting_faults(page) == []
    page.locator(".vs-hints button", has_text="Got it").click()
    page.locator(".vs-hints").wait_for(state="detached")

    t = runner.snapshot.t
    page.reload()
    page.get_by_text("real time").wait_for()
    page.wait_for_function(f"{CHARTS}.some((c) => c.data?.[0]?.length > 100)")
    assert not page.locator(".vs-hints").count()
    assert runner.snapshot.phase == "running"
    assert runner.snapshot.t > t


def test_a_field_gives_the_keys_back_on_enter_and_on_escape(session: PageSession):
    page, text = session.page, session.number("radius [m]")
    for key, radius in (("Enter", 0.03), ("Escape", 0.03)):
        fill_in(text, "0.03" if key == "Enter" else "0.04")
        text.press(key)
        session.wait(lambda now, radius=radius: now.scenario.motion.radius == radius)
        phase = session.now.phase
        page.keyboard.press("Space")
        session.wait(lambda now, phase=phase: now.phase != phase)
        page.keyboard.press("Space")
        session.wait(lambda now, phase=phase: now.phase == phase)


@pytest.mark.usefixtures("messages_stay")
def test_a_message_moves_nothing(session: PageSession):
    page = session.page
    buttons = page.get_by_role("button", name="play / pause")
    session.runner.post(Pause())  # a busy machine would say that the loop cannot keep up
    page.locator(".vs-status[data-phase=paused]").wait_for()
    page.locator(".vs-strip .vs-message").wait_for(state="detached")
    before = resting_box(buttons)
    session.runner.post(Edit("controller.period", -1.0))
    page.locator(".vs-strip .vs-message", has_text="control period").wait_for()
    assert resting_box(buttons) == before
    page.wait_for_function("""() => {
      const box = (part) => document.querySelector(part).getBoundingClientRect();
      const strip = box(".vs-strip"), scene = box("canvas[data-engine]");
      return strip.height > 10 && scene.left <= strip.left && strip.right <= scene.right;
    }""")


@pytest.mark.usefixtures("messages_stay")
def test_a_drag_over_a_message_selects_it_at_most_and_nothing_of_the_page(session: PageSession):
    page = session.page
    session.runner.post(Edit("controller.period", -1.0))
    message = page.locator(".vs-strip .vs-message", has_text="control period: −1")
    text = message.inner_text()
    for paused in (False, True):
        session.runner.post(Pause() if paused else Play())
        page.locator(f".vs-status[data-phase={'paused' if paused else 'running'}]").wait_for()
        for _ in range(20):  # another message, on a slow loop, may come and go above it, and move it under the mouse
            selected = dragged(page, message, paused=paused)
            if len(selected) == 2 and all(part and part in text for part in selected):
                break
            page.mouse.click(640, 250)
        assert len(selected) == 2
        for part in selected:
            assert part
            assert part in text
        page.mouse.click(640, 250)


def dragged(page: Page, message: Locator, *, paused: bool) -> list[str]:
    """What is selected by a drag over the message, while the mouse is held and when it has been let go; empty where the
    message was not at the same place all the time."""
    place = "(message) => { const { x, y } = message.getBoundingClientRect(); return [x, y]; }"
    t = page.locator(".vs-number").first.inner_text()
    message.hover(position={"x": 30, "y": 14})  # once it rests
    before = message.evaluate(place)
    page.mouse.down()
    page.mouse.move(1100, 300, steps=12)
    if not paused:  # the message is sent again with every status, and stays selected
        expect(page.locator(".vs-number").first).not_to_have_text(t)
    while_held = page.evaluate("getSelection().toString()")
    page.mouse.up()
    selected = [while_held, page.evaluate("getSelection().toString()")]
    return selected if message.evaluate(place) == before else []


def test_the_target_model_stays_within_the_scene_of_a_small_window(session: PageSession):
    session.runner.post(Pause())
    for width, height in ((1024, 768), (853, 480), (1024, 768)):  # the second is 1280 x 720 at 150 %
        session.page.set_viewport_size({"width": width, "height": height})
        session.page.wait_for_function(WITHIN)
        assert not lasting_faults(session.page)
        if height > 560:  # it comes back by itself also where viser places it after the docks have their new width
            session.page.evaluate(f"{EQUATION}.style.marginLeft = '-500px'")
            session.page.wait_for_function(WITHIN)
            session.page.evaluate(f"{EQUATION}.style.marginLeft = ''")
            session.page.wait_for_function(WITHIN)


# the window of a held slider, in the scene and beside the label of the tool
TOOL_IN_SIGHT = """() => {
  const [held, scene] = ["[data-floating-window]:has(.vs-held)", "canvas[data-engine]"]
    .map((part) => document.querySelector(part)?.getBoundingClientRect());
  const tool = [...document.querySelectorAll(".vs-labels span[data-shown]")]
    .find((label) => label.textContent === "drag this ball")?.getBoundingClientRect();
  return held?.width && tool && tool.bottom <= held.top && held.bottom <= scene.bottom && scene.left <= held.left;
}"""


# how many rows of the table stand in the window, NaN where one does not
ROWS_IN_SIGHT = """((rows) => rows.every((row) => {
  const { x, y, width, height } = row.getBoundingClientRect();
  return height && row.contains(document.elementFromPoint(x + width / 2, y + height / 2));
}) ? rows.length : NaN)([...document.querySelectorAll(".vs-preview .vs-foreseen tr")])"""


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (1024, 768), (1440, 900), (1920, 1080), (768, 1024)])
def test_the_tool_is_in_sight_while_a_slider_is_held(session: PageSession, width: int, height: int):
    """Also on a tablet that is held upright, where the plots stand above the scene."""
    page = session.page
    page.set_viewport_size({"width": width, "height": height})
    page.locator("html[data-upright]").wait_for(state="attached" if width < height else "detached")
    if width < height:
        page.wait_for_function(
            "document.querySelector('canvas[data-engine]').getBoundingClientRect().width > 0.4 * innerWidth"
        )
    page.wait_for_function(WITHIN)
    assert not lasting_faults(page)
    move, _ = session.grip("F_d [N]")
    move(0.6)
    page.get_by_text("within the next").wait_for()
    page.wait_for_function(TOOL_IN_SIGHT)
    if height > 800 and width > height:  # with all results: nothing can be scrolled while the mouse holds a slider
        page.wait_for_function(f"{ROWS_IN_SIGHT} > 9")
        page.wait_for_function(TOOL_IN_SIGHT)
    page.keyboard.press("Escape")
    page.mouse.up()
    expect(page.locator(".vs-equation").first).to_be_visible()  # in whose place it was


def test_everything_has_a_name_and_a_slider_its_value_with_unit(session: PageSession):
    page = session.page
    page.wait_for_function("document.title === 'VSMRC Lab'")
    slider = page.get_by_role("slider", name="F_d [N]", exact=True)
    expect(slider).to_have_attribute("aria-valuetext", "20 N")
    session.runner.post(Edit("force.value", 25.0))
    expect(slider).to_have_attribute("aria-valuetext", "25 N")
    session.tab("Model")
    row = page.get_by_role("slider", name=re.compile("^M_?m φ$"))
    expect(row).to_have_attribute("aria-valuetext", re.compile(r"^\S+ kg$"))
    for tab in ("Controller", "World", "Robot", "View", "Task"):
        session.tab(tab)
        page.wait_for_function("""() => [...document.querySelectorAll("button, input, [role=slider], [role=tab]")]
          .filter((e) => e.checkVisibility() && e.type !== "submit")
          .every((e) => e.innerText?.trim() || e.getAttribute("aria-label") || e.title || e.labels?.length)""")
    assert not page.locator(".tabler-icon-adjustments:visible").count()  # viser's own, for developers
