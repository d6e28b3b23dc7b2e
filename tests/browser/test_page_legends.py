"""Legends of the plots in a real browser: values of now, and lines that are hidden."""

from __future__ import annotations

from playwright.sync_api import expect

from app.session.commands import Pause, Play
from controllers.bounds import CAUSES
from drivers.pages import SHOWN, PageSession


def test_the_legend_has_the_values_of_now_and_hides_a_line(session: PageSession):
    page = session.page
    session.pause_after(1.0)
    page.mouse.move(700, 300)  # over no plot
    legend_entry = (
        "(name) => [...document.querySelectorAll('.u-series')].find((e) => e.innerText.startsWith(name))?.innerText"
    )
    desired = session.now.scenario.force.value
    page.wait_for_function(f"({legend_entry})('desired normal')?.endsWith('{desired:g}')")
    measured = float(session.now.recording.signals(("F_c",))["F_c"][-1, 0])
    page.wait_for_function(
        f"(value) => Math.abs(({legend_entry})('measured normal')?.match(/[-\\d.]+$/)?.[0] - value) <= 0.01 * value",
        arg=measured,
    )
    line = page.locator(".u-series:visible", has_text="measured normal").locator("th")
    line.click()
    page.locator(".u-series.u-off:visible", has_text="measured normal").wait_for()
    line.click()
    page.locator(".u-series.u-off:visible").wait_for(state="hidden")


def test_a_legend_tells_the_parts_of_a_sum_and_no_number_of_a_shading(session: PageSession):
    page = session.page
    session.pause_after(1.0)
    session.tab("Guarantee")
    page.mouse.move(700, 300)  # over no plot
    value = "(name) => [...document.querySelectorAll('.u-series')].find((e) => e.checkVisibility() && \
        e.querySelector('.u-label').textContent === name)?.querySelector('.u-value').textContent"
    needed = session.now.recording.signals(("needed",))["needed"][-1]
    for cause, part in zip(CAUSES.values(), needed, strict=True):  # not the sum up to it; a plot leaves rows out
        page.wait_for_function(f"([name, part]) => Math.abs(({value})(name) - part) <= 0.1", arg=[cause, float(part)])
    session.tab("Sliding")
    page.wait_for_function(f"+({value})('‖s‖') > 0")
    unmeasured = ("reaching", "sliding", "t_r ≤ (18)", "t_r")
    session.wait(lambda _: [page.evaluate(value, name) for name in unmeasured] == 4 * [""])
    page.locator(".u-over:visible").first.hover()
    time = page.locator(".u-legend:visible").nth(1).locator(".u-value").first  # of a plot that shares the crosshair
    expect(time).not_to_have_text("")
    session.runner.post(Play())  # drawn again and again
    session.wait(lambda now: now.t > 2.0)
    assert time.inner_text()
    session.runner.post(Pause())
    session.wait(lambda now: now.phase == "paused")
    page.mouse.move(700, 300)
    expect(time).to_have_text("")
    page.wait_for_function(f"+({value})('‖s‖') > 0")


def test_a_part_of_a_sum_is_hidden_and_stands_alone_with_both_edges_of_its_area(session: PageSession):
    page = session.page
    session.pause_after(1.0)
    session.tab("Torque")
    stack = f"{SHOWN}.find((c) => c.series.filter((s) => s.label === 'gravity').length === 2)"
    page.wait_for_function(stack)
    drawn = f"() => {stack}.series.slice(1).filter((s) => s.show).map((s) => s.label).sort()"
    every = page.evaluate(drawn)
    assert every.count("gravity") == every.count("switching") == 2  # above and below zero
    chart = page.locator(".uplot-container:visible", has=page.locator(".u-series:visible", has_text="gravity"))
    entry = chart.locator(".u-series:visible", has_text="gravity").locator("th")
    entry.click()
    session.wait(lambda _: page.evaluate(drawn) == [label for label in every if label != "gravity"])
    entry.click()
    session.wait(lambda _: page.evaluate(drawn) == every)
    entry.click(modifiers=["ControlOrMeta"])
    session.wait(
        lambda _: page.evaluate(drawn) == ["Value", "gravity", "gravity"]
    )  # with the line at zero, as uPlot calls it
    entry.click(modifiers=["ControlOrMeta"])
    session.wait(lambda _: page.evaluate(drawn) == every)
