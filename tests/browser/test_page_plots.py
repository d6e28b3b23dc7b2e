"""The dock of plots in a real browser."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from app.dashboard.page import Dashboard
from app.dashboard.plots.charts import Setup
from app.dashboard.plots.plot_table import TABS
from app.session.commands import Edit, Pause, Play, Reset, Seek
from app.session.runner import Runner
from app.session.snapshot import Snapshot
from drivers.pages import CHARTS, SHOWN, PageSession, resting_box

FULL = f"{SHOWN}.length && {SHOWN}.every((c) => c.data?.[0]?.length > 20 && c.data.length > 1)"
# how many charts on the screen, and how many of the others, get data within a while
DRAWN = f"""async (wait) => {{
  const before = {CHARTS}.map((c) => [c, c.data]), shown = new Set({SHOWN});
  await new Promise((done) => setTimeout(done, wait));
  const drawn = before.filter(([c, data]) => c.data !== data).map(([c]) => c);
  return [drawn.filter((c) => shown.has(c)).length, drawn.filter((c) => !shown.has(c)).length];
}}"""


def test_every_tab_shows_curves_and_a_hidden_one_costs_nothing(session: PageSession):
    page = session.page
    setup = Setup.of(session.runner.snapshot, 0, 0)
    drawn = {name: [plot for plot in tab.plots if plot.draw(setup) is not None] for name, tab in TABS.items()}
    page.wait_for_function(FULL)
    session.runner.post(Pause())  # what moves makes a look slow
    for name in TABS:
        session.tab(name)
        page.wait_for_function(f"{SHOWN}.length === {len(drawn[name])} && {FULL}")
        page.wait_for_function(
            f"{SHOWN}.every((c) => c.data.slice(1).some((y) => y.length > 20 && y.every(Number.isFinite)))"
        )
    page.wait_for_function(f"{CHARTS}.length === {sum(len(plots) for plots in drawn.values())}")
    session.runner.post(Play())
    # not at once: what was on its way to the tab before is drawn
    session.wait(lambda _: page.evaluate(DRAWN, 1500) == [len(TABS["Residual"].plots), 0])


@pytest.mark.usefixtures("new_page", "from_the_start")
def test_plots_fill_the_height_of_the_page_whatever_pixels_the_scene_has(
    served: tuple[Dashboard, Runner], open_page: Callable[..., Page]
) -> None:
    """viser draws several pixels for one of the page on a fine screen, and fewer on a slow machine."""
    page = open_page(served[0].url, viewport={"width": 1600, "height": 1000}, device_scale_factor=2)
    page.get_by_text("real time").wait_for()
    page.wait_for_function(FULL)
    page.wait_for_function(
        """() => {
          const shown = [...document.querySelectorAll(".uplot-container")].filter((each) => each.checkVisibility());
          const bottom = shown.at(-1)?.getBoundingClientRect().bottom;
          return bottom > 850 && bottom < 1000;
        }"""
    )


@pytest.mark.usefixtures("spent_page")
def test_a_plot_that_has_missed_that_its_dock_became_narrow_fits_into_it(session: PageSession):
    page = session.page
    page.wait_for_function(FULL)
    page.evaluate(f"() => {SHOWN}[1].setSize({{ width: 700, height: 100 }})")
    page.wait_for_function(f"{SHOWN}.every((c) => c.width <= c.root.closest('.uplot-container').clientWidth + 2)")


def test_the_chosen_window_moves_the_axes_and_builds_no_chart_anew(session: PageSession):
    page = session.page
    session.wait(lambda now: now.t > 4.5)
    page.wait_for_function(f"{FULL} && {SHOWN}.every((c) => c.scales.x.min === -8)")
    created = "Object.values(__viserTestpoints.uplots).map((p) => p.createCount)"
    before = page.evaluate(created)
    session.choose("window", "4 s")
    page.wait_for_function(f"{SHOWN}.every((c) => c.scales.x.min === -4 && c.data[0][0] > -4.1 && c.data[0][0] < -3.9)")
    for _ in range(5):  # a zoom while the axes of new data are just being set is lost, and made again
        page.evaluate(f"{SHOWN}[0].setScale('x', {{ min: -3, max: -1 }})")
        page.wait_for_timeout(1500)
        if page.evaluate(f"{SHOWN}[0].scales.x.min") == -3:
            break
    assert page.evaluate(f"{SHOWN}.map((c) => c.scales.x.min)") == [-3, -4, -4, -4]  # a zoom stays
    assert page.evaluate(created) == before
    session.choose("window", "8 s")


def test_a_line_that_begins_with_what_does_not_exist_has_an_axis(session: PageSession):
    session.runner.post(Edit("controller.law", "computed-torque"))
    session.runner.post(Reset())
    session.wait(lambda now: now.scenario.controller.law == "computed-torque" and now.recording.first == 0.0)
    session.wait(lambda now: now.t > 0.3)
    session.runner.post(Edit("controller.law", "vsmrc"))
    session.wait(lambda now: now.scenario.controller.law == "vsmrc" and now.t > 0.8)
    session.runner.post(Pause())  # with the beginning in the window, however long the page takes
    gain = f"{SHOWN}.find((c) => c.root.querySelector('.u-title')?.textContent.includes('(17)'))"
    session.page.wait_for_function(f"""() => {{
      const gain = {gain}, {{ min, max }} = gain?.scales.y ?? {{}};
      const line = gain?.data?.[1];
      return line && Number.isNaN(line[0]) && min === 0 && max >= line.at(-1) && gain.axes[1]._splits;
    }}""")


def test_a_run_that_has_just_been_reset_keeps_the_axes_of_its_plots(session: PageSession):
    session.page.wait_for_function(FULL)
    for command in (Pause(), Reset()):
        session.runner.post(command)
    session.wait(lambda now: now.t == 0.0 and now.phase == "paused")
    numbers = "c.axes[1]._values?.filter((v) => v !== '').length"
    laid_out = f"c.data?.[0]?.length < 20 && c.bbox.left > 30 && {numbers} > 1"
    session.page.wait_for_function(f"{SHOWN}.every((c) => {laid_out})")


def test_the_chosen_joint_is_drawn_and_a_paused_run_is_not_drawn_again(session: PageSession):
    page = session.page
    session.tab("Torque")
    page.get_by_label("joint", exact=True).wait_for()
    session.tab("Overview")
    # also while it is hidden, each of the two choices of a row has a name of its own
    page.wait_for_function("document.querySelectorAll('input[aria-label=joint]').length > 0")
    session.tab("Torque")
    session.choose("joint", "2 ", exact=False)
    page.locator(".u-title", has_text="terms of τ₂ (25)").wait_for()
    session.runner.post(Pause())
    session.wait(lambda now: now.phase == "paused")
    session.wait(lambda _: page.evaluate(DRAWN, 1500) == [0, 0])  # not at once: what was on its way is drawn
    session.choose("joint", "1 ", exact=False)
    page.locator(".u-title", has_text="terms of τ₁ (25)").wait_for()
    page.wait_for_function(FULL)


def test_nothing_is_drawn_for_a_page_that_nobody_sees(session: PageSession):
    page = session.page
    page.wait_for_function(FULL)
    page.evaluate(
        "Object.defineProperty(document, 'hidden', { configurable: true, get: () => true });"
        "document.dispatchEvent(new Event('visibilitychange'))"
    )
    session.wait(lambda _: page.evaluate(DRAWN, 1500) == [0, 0])
    page.evaluate("delete document.hidden; document.dispatchEvent(new Event('visibilitychange'))")
    page.wait_for_function(f"(window.vsOld ??= {SHOWN}[0].data) !== {SHOWN}[0].data")


def test_points_that_came_one_after_the_other_are_the_whole_data(
    session: PageSession, served: tuple[Dashboard, Runner]
):
    page, view = session.page, served[0]._content  # pyright: ignore[reportPrivateUsage]
    assert view is not None

    def all_sent(now: Snapshot) -> bool:
        """Whether the plots have been drawn up to the last instant, also on a machine that rests in between."""
        drawn = view._plots._drawn["Overview"]  # pyright: ignore[reportPrivateUsage]
        return drawn[:3] == (now.run, now.revision, now.t)

    page.wait_for_function(FULL)
    began = session.now.t
    session.wait(lambda now: now.t > began + 3.0)
    session.runner.post(Pause())
    session.wait(lambda now: now.phase == "paused")
    session.wait(all_sent)
    session.wait(lambda _: page.evaluate(DRAWN, 800) == [0, 0])
    page.evaluate(f"window.vsCame = {SHOWN}.map((c) => c.data)")
    page.evaluate("window.dispatchEvent(new Event('vsmrc-behind'))")  # all of them at once
    page.wait_for_function(f"{SHOWN}.every((c, k) => c.data !== vsCame[k])")
    lengths = "map((data) => data.map((line) => line.length))"
    assert page.evaluate(f"{SHOWN}.map((c) => c.data).{lengths}") == page.evaluate(f"vsCame.{lengths}")
    differ = page.evaluate(f"""{SHOWN}.flatMap((c, k) => c.data.flatMap((line, j) => Array.from(line).filter(
        (y, i) => !(Math.abs(y - vsCame[k][j][i]) <= 1e-5 || Object.is(y, vsCame[k][j][i])))))""")
    assert differ == []


def test_the_crosshair_tells_values_and_a_plot_can_be_enlarged(session: PageSession):
    page = session.page
    page.wait_for_function(FULL)
    session.runner.post(Pause())
    session.wait(lambda now: now.phase == "paused")
    plot = page.locator(".uplot-container:visible").nth(1)
    small, values = resting_box(plot), page.locator(".vs-values")
    plot.locator(".u-over").hover()
    values.get_by_text("measured normal").wait_for()
    page.wait_for_function(f"""() => {{
      const {{ data, cursor }} = {SHOWN}[1], value = data[2][cursor.idx], told = document.querySelector(".vs-values");
      return told.innerText.split("\\n").includes(String(+value?.toPrecision(4)));
    }}""")

    plot.locator(".mantine-ActionIcon-root").click()
    page.wait_for_function(f"{SHOWN}[1].height > 400")
    enlarged = resting_box(plot)
    assert enlarged["width"] > 1.5 * small["width"]
    # nothing lies over it
    for fraction in (0.1, 0.5, 0.9):
        x, y = enlarged["x"] + fraction * enlarged["width"], enlarged["y"] + fraction * enlarged["height"]
        assert page.evaluate("([x, y]) => !!document.elementFromPoint(x, y).closest('[data-large]')", [x, y])
    page.keyboard.press("Escape")
    page.wait_for_function(f"{SHOWN}[1].height < 200")
    session.wait(lambda _: resting_box(plot) == small)
    page.wait_for_function(f"{SHOWN}[1].axes[0]._splits?.length <= 10")  # no longer those of the large one


def test_two_cursors_measure_a_step(session: PageSession):
    page = session.page
    session.pause_after(2.0)  # so that the step comes, and the window ends, at an instant that is known
    step = {"kind": "step", "start": 20.0, "value": 30.0, "time": session.now.t + 0.5, "rise": 0.1}
    session.runner.post(Edit("force", step))
    session.runner.post(Play())
    session.wait(lambda now: now.t > step["time"] + 1.6)
    session.runner.post(Seek(step["time"] + 1.6))
    session.wait(lambda now: now.t == pytest.approx(step["time"] + 1.6))
    session.page.get_by_text("looking back", exact=True).wait_for()
    page.locator(".uplot-container").nth(1).hover()
    page.locator(".vs-measure").nth(1).click()
    table = page.locator(".vs-measured")
    table.wait_for()
    expect(page.locator(".uplot-container[data-large] .u-over")).to_be_visible()
    expect(page.locator(".vs-cursor")).to_have_count(2)
    for _ in range(5):  # the plot may get another size while a cursor is dragged
        over = resting_box(page.locator(".uplot-container[data-large] .u-over"))
        for cursor, fraction in ((0, 0.76), (1, 0.99)):
            box = resting_box(page.locator(".vs-cursor").nth(cursor))
            page.mouse.move(box["x"] + 1, box["y"] + 200)
            page.mouse.down()
            page.mouse.move(over["x"] + fraction * over["width"], over["y"] + 200, steps=5)
            page.mouse.up()
        if "Δt = 1.84 s" in table.inner_text():
            break
    assert "Δt = 1.84 s" in table.inner_text()  # of a window of 8 s
    cursor = page.get_by_role("slider", name="cursor B")
    cursor.focus()
    page.keyboard.press("ArrowLeft")
    expect(table).to_contain_text("Δt = 1.76 s")
    expect(cursor).to_have_attribute("aria-valuetext", re.compile(r"^−0\.1\d* s$"))
    expect(cursor).to_have_attribute("aria-valuenow", re.compile(r"^-0\.1\d*$"))
    page.keyboard.press("ArrowRight")
    expect(table).to_contain_text("Δt = 1.84 s")
    assert session.now.t == pytest.approx(step["time"] + 1.6)  # the arrow keys have not stepped through the run
    fonts = f"{SHOWN}.map(({{ axes }}) => axes.map(({{ font }}) => font[1] / font[2] / devicePixelRatio)).flat()"
    assert page.evaluate(fonts) == pytest.approx([1.0] * len(page.evaluate(fonts)), rel=0.05)
    row = table.locator("tr", has_text="desired normal").locator("td").all_inner_texts()
    now = session.now
    rows = now.recording.signals(("t", "F_cd"), now.t - 8.0 * 0.24, now.t - 8.0 * 0.01)
    assert float(row[0]) == pytest.approx(rows["F_cd"][-1, 0] - rows["F_cd"][0, 0], abs=0.05)
    assert row[1] == "0 %"
    page.keyboard.press("Escape")
    table.wait_for(state="detached")
    page.locator(".vs-enlarge").nth(1).press("Enter")  # without the mouse
    page.locator(".uplot-container[data-large]").wait_for()
    page.keyboard.press("Escape")
    expect(page.locator(".uplot-container[data-large]")).to_have_count(0)


# Numbers of an axis of a plot so many px high, with their places, for the splits that uPlot would give it.
NUMBERS = """({ kind, low, high, tall }) => {
  const logarithmic = kind === "decades", place = logarithmic
    ? (v) => tall * (1 - Math.log10(v / low) / Math.log10(high / low)) : (v) => (tall * (high - v)) / (high - low);
  const plot = { axes: [null, { font: ["", 12] }], valToPos: place }, size = 10 ** Math.floor(Math.log10(low));
  const incr = [1, 2, 2.5, 5, 10, 20, 25, 50, 100, 200].find((each) => (tall * each) / (high - low) >= 14);
  const splits = () => {
    const at = [];
    if (!logarithmic) for (let v = Math.ceil(low / incr) * incr; v <= high; v += incr) at.push(v);
    else for (let v = low, step = size; v <= high * (1 + 1e-9); v = +(v + step).toPrecision(9)) {
      at.push(v);
      if (v + step >= 10 * step * (1 + 1e-9) && v >= 10 * step * (1 - 1e-9)) { at.pop(); step *= 10; at.push(v); }
    }
    return at;
  };
  const at = (logarithmic ? halved : three)(splits)(plot, 1, low, high, incr, (tall * incr) / (high - low));
  const told = logarithmic ? decades(plot, at) : written(at);
  return at.flatMap((v, i) => (told[i] === "" ? [] : [[Number(told[i].replace("−", "-")), place(v), v]]));
}"""


# Texts under the crosshair and between two cursors, of a logarithmic plot whose line falls to its foot.
FALLEN = """() => {
  const plot = {
    scales: { x: { min: 0, max: 1 }, y: { min: 0.01, max: 100, distr: 3 } },
    data: [[0, 0.5, 1], [50, 20, 0.01], [50, 20, 1]],
    series: [{ label: "t" }, { label: "s", show: true }, { label: "hidden", show: false }], bands: [],
    root: document.createElement("div"), cursor: { idx: 2, left: 5, top: 5 },
    over: { matches: () => true, getBoundingClientRect: () => ({ left: 0, top: 0 }) },
  };
  const table = document.createElement("table");
  document.body.append(table);
  fillTable(plot, [0, 1], table);
  showValues(plot);
  const rows = [...table.rows].map((row) => [...row.cells].map((cell) => cell.textContent));
  return [rows.slice(2).map(([name, step]) => [name, step]), [...values.children].map((row) => row.textContent)];
}"""


def test_the_foot_of_a_logarithmic_plot_is_said_to_be_one_and_a_fall_is_a_number(browser: Browser) -> None:
    page = browser.new_page()
    plots, reading = (Path(f"static/page/{name}.js").read_text(encoding="utf-8") for name in ("plots", "reading"))
    page.add_script_tag(content=f"{{{plots}}}\n{reading}")  # names of the former are its own
    measured, under_the_crosshair = page.evaluate(FALLEN)
    page.close()
    assert measured == [["s", "−50"]]
    assert under_the_crosshair == ["t 1", "s ≤ 0.01"]


def test_an_axis_has_three_numbers_that_stand_apart_however_low_its_plot(browser: Browser):
    page = browser.new_page()
    page.add_script_tag(content=Path("static/page/plots.js").read_text(encoding="utf-8"))
    ends = [(6, 100), (4, 70), (30, 40), (3, 9), (0.004, 0.01), (0.1, 100), (0.001, 10), (1, 10), (2, 3), (8, 20)]
    cases = [("decades", *pair) for pair in ends] + [("three", 0, high / 10) for high in range(11, 120)]
    cases += [("three", -1.1, 3.0), ("three", 0, 3.95), ("three", 1.9, 5.85)]
    each = [
        {"kind": kind, "low": low, "high": high, "tall": tall} for kind, low, high in cases for tall in (51, 77, 182)
    ]
    for asked, numbers in zip(each, page.evaluate(f"(each) => each.map({NUMBERS})", each), strict=True):
        low, high = asked["low"], asked["high"]
        places = sorted(place for _, place, _ in numbers)
        assert len(numbers) >= 3, asked
        assert min(b - a for a, b in pairwise(places)) > 12.0, (asked, numbers)
        assert all(low - 1e-9 <= value <= high + 1e-9 for value, _, _ in numbers), (asked, numbers)
        assert all(abs(value - at) < 1e-6 * (high - low) for value, _, at in numbers), (asked, numbers)
    # of a run that diverges
    assert page.evaluate("written([0, 1.5e17, 3e17])") == ["0", "1.5·10¹⁷", "3·10¹⁷"]
    assert page.evaluate("[3.18123e17, -2e6, 12345.678, -0.25, 2e-7].map((value) => vsmrcNumber(value, 3))") == [
        "3.18·10¹⁷", "−2·10⁶", "12300", "−0.25", "2·10⁻⁷",
    ]  # fmt: skip
    assert page.evaluate("written([-1e-7, 0, 1e-7])") == ["−1·10⁻⁷", "0", "10⁻⁷"]
    page.close()
