"""What the gateway adds to the page: links, watching, a copy, and what is said after a crash."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Callable, Iterator

import pytest
from playwright.sync_api import Page, expect

from app.dashboard.theme.fonts import FACES
from drivers.pages import CHARTS, PATIENCE, VIEWPORT, open_tab, wait_without_notice
from drivers.visitors import Server, serving

RUNNING = "promise holds"
LOADED = """async (families) => {
  for (const family of families) await document.fonts.load(`12px "${family}"`);
  const loaded = [...document.fonts].filter((font) => font.status === "loaded").map((font) => font.family).join();
  return families.every((family) => loaded.includes(family));
}"""


def links_of(page: Page) -> list[str]:
    """Links of the card that the button Share opens: to watch, and to steer."""
    fields = page.locator(".vg-card").get_by_role("textbox", name=re.compile("^To "))
    expect(fields).to_have_count(2)
    return [field.input_value() for field in fields.all()]


@pytest.fixture(scope="module")
def shared() -> Iterator[Server]:
    with serving("ur5-hybrid", "--shared", "--max-sessions", "2", lines=2, fps=4) as server:
        yield server


def test_watcher_cannot_steer_and_a_private_copy_recovers_from_a_crash(
    shared: Server, open_page: Callable[..., Page]
) -> None:
    refused, asked = list[str](), list[str]()

    def opened(url: str, **options) -> Page:
        # where a session has died, the browser notes that the web socket could not be opened
        page = open_page(url, viewport=VIEWPORT, console_errors_allowed=True, **options)
        page.on("console", lambda message: "Security Policy" in message.text and refused.append(message.text))
        page.on("request", lambda request: asked.append(request.url))
        page.set_default_timeout(PATIENCE * 1e3)
        page.get_by_text(RUNNING).wait_for()
        wait_without_notice(page)
        return page

    lecturer = opened(shared.url)
    lecturer.wait_for_function(LOADED, arg=[face.family for face in FACES])
    assert not [url for url in asked if "127.0.0.1" not in url and not url.startswith(("data:", "blob:"))]
    lecturer.get_by_role("button", name="Share").click()
    watch, steer = links_of(lecturer)
    assert steer == lecturer.url.partition("?")[0]
    lecturer.evaluate("""() => {
        Object.defineProperty(navigator, "clipboard", { value: undefined }); // as without TLS
        document.execCommand = () => false;
    }""")
    card, share = lecturer.locator(".vg-card:visible"), lecturer.get_by_role("button", name="Share")
    card.get_by_role("button", name="copy").first.click()
    expect(card.get_by_role("button").first).to_have_text("press Ctrl+C")
    expect(card.get_by_role("textbox").first).to_be_focused()
    lecturer.keyboard.press("Escape")
    expect(lecturer.locator(".vg-card input").first).to_be_hidden()
    expect(share).to_have_attribute("aria-expanded", "false")
    expect(share).to_be_focused()

    student = opened(watch)
    expect(student.get_by_text("Watching live")).to_be_visible()
    row = student.locator("form:visible", has=student.get_by_text("F_d [N]", exact=True))
    force = row.locator(".mantine-TextInput-input")
    expect(force).to_have_css("pointer-events", "none")
    expect(student.locator(".vs-tools [data-key=t]")).to_be_hidden()
    for page, seen in ((lecturer, True), (student, False)):
        expect(page.locator("button:has(.tabler-icon-list-search)")).to_be_visible(visible=seen)
    helped, palette = student.get_by_role("dialog", name="VSMRC Lab"), student.get_by_placeholder("Search commands")
    for chord in ("Control+k", "Control+Shift+p", "Meta+k"):
        force.focus()
        student.keyboard.press(chord)
        student.keyboard.press("Escape")  # leaves the field
        expect(force).not_to_be_focused()
        student.keyboard.press(chord)
        student.keyboard.press("?")
        expect(helped).to_contain_text("presentation")
        expect(helped).not_to_contain_text("pin this run", use_inner_text=True)
        expect(palette).to_have_count(0)
        student.keyboard.press("Escape")
        expect(helped).to_have_count(0)
    student.keyboard.press("Tab")
    assert student.evaluate(
        "document.activeElement !== document.body && !document.activeElement.closest('[role=dialog]')"
    )
    expect(palette).to_have_count(0)
    expect(lecturer.locator(".vs-help")).to_have_count(0)
    expect(student.locator(".vs-acts button").first).to_have_css("pointer-events", "none")
    open_tab(student, "Torque")  # looking around is free
    expect(student.locator(".uplot-container:visible").first).to_be_visible()
    student.locator(".vs-legend-button").click()
    expect(student.locator(".vs-legend")).to_be_visible()
    student.locator(".uplot-container:visible").first.hover()
    student.locator(".vs-measure:visible").first.click()
    student.locator(".vs-measured").wait_for()
    student.keyboard.press("Escape")
    for _ in range(3):  # the curves go on, not only the first ones are sent
        student.evaluate(f"() => {{ window.noted = {CHARTS}.map((chart) => chart.data); }}")
        student.wait_for_function(f"{CHARTS}.some((chart, i) => chart.data !== window.noted[i])")
    lecturer.locator("canvas[data-engine]").click(position={"x": 20, "y": 300})
    lecturer.keyboard.press("1")
    expect(student.locator(".vs-status")).to_contain_text("Motion", timeout=PATIENCE * 1e3)
    expect(lecturer.get_by_text("2 pages open")).to_be_visible()
    lecturer.keyboard.press(" ")  # it rests while the copy is made and fails

    student.get_by_role("button", name="Take a private copy").click()
    student.wait_for_url(re.compile(r"/s/[^/]+/"))
    expect(student.locator(".vs-status")).to_contain_text("Motion", timeout=PATIENCE * 1e3)
    expect(student.get_by_role("button", name="Share")).to_be_visible()

    os.kill(shared.children()[-1], signal.SIGKILL)
    expect(student.get_by_text("This session was interrupted")).to_be_visible(timeout=PATIENCE * 1e3)
    expect(student.locator(".vs-status")).to_contain_text("Motion", timeout=PATIENCE * 1e3)
    assert lecturer.get_by_text("This session was interrupted").count() == 0
    assert not refused


def test_links_are_taken_back_with_a_button(open_page: Callable[..., Page]) -> None:
    """And a browser sends the token of a session to that session, and to no other address."""
    with serving("planar2r-semicircle", "--token", "always", lines=2, fps=4) as server:

        def opened(url: str) -> Page:
            page = open_page(url, viewport=VIEWPORT, console_errors_allowed=True)
            page.set_default_timeout(PATIENCE * 1e3)
            page.locator(".vs-status").wait_for()
            page.get_by_role("button", name="Share").click()
            return page

        presenter = opened(server.url)
        watch, steer = links_of(presenter)
        guest = opened(steer)
        assert guest.url == presenter.url == steer.partition("?")[0]
        assert guest.get_by_role("button", name="New links").count() == 0
        sent = {cookie["name"]: cookie["path"] for cookie in guest.context.cookies()}
        assert sent[f"vsmrc-steer-{server.port}"] == guest.url.rpartition("/")[0].partition(str(server.port))[2]
        presenter.once("dialog", lambda dialog: dialog.accept())
        with presenter.expect_navigation(url=lambda url: url != guest.url):
            presenter.get_by_role("button", name="New links").click()
        expect(guest.get_by_text("This link leads nowhere any more")).to_be_visible(timeout=PATIENCE * 1e3)
        presenter.get_by_role("button", name="Share").click()
        renewed = links_of(presenter)
        assert not {*renewed} & {watch, steer}
        assert renewed[1].partition("?")[0] == presenter.url.partition("?")[0]
        guest.goto(steer)
        expect(guest.get_by_text("it was taken back")).to_be_visible()


def test_a_page_loads_and_sends_nothing_from_or_to_elsewhere(shared: Server, open_page: Callable[..., Page]) -> None:
    """On a page that only says that there is nothing: every answer has the same policy (test_hostile_requests.py)."""
    page = open_page(f"{shared.url}/s/guessed/", console_errors_allowed=True)
    violated = page.evaluate("""async () => {
        const seen = new Set();
        document.addEventListener("securitypolicyviolation", (e) => seen.add(e.effectiveDirective));
        const elsewhere = "http://127.0.0.1:9/";
        for (const tag of ["script", "img", "iframe"])
            document.body.append(Object.assign(document.createElement(tag), { src: elsewhere }));
        document.head.append(Object.assign(document.createElement("base"), { href: elsewhere }));
        const form = Object.assign(document.createElement("form"), { action: elsewhere, method: "post" });
        document.body.append(form);
        form.submit();
        try { await fetch(elsewhere); } catch { /* refused */ }
        while (seen.size < 6) await new Promise((then) => setTimeout(then, 20));
        return [...seen].sort();
    }""")
    assert violated == ["base-uri", "connect-src", "form-action", "frame-src", "img-src", "script-src-elem"]
