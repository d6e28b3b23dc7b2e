"""The page of one of a class: a question is answered by keyboard alone, and a reader hears what is new."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import msgspec
import pytest
from playwright.sync_api import expect

from app.access.classroom import POINTS, ClassQuestion, Classroom
from app.gateway import pages

STATIC = Path(__file__).parents[2] / "static" / "gateway"
CURVE = ClassQuestion(1, "curve", "Draw the force.", end=2.0, high=30.0, axis="F_n [N]")
NUMBER = ClassQuestion(3, "number", "How far?", unit="mm")
CHOICE = ClassQuestion(2, "choice", "Which?", options=("less", "more"))
GERMAN = ClassQuestion(4, "choice", "Welche?", options=("weniger", "mehr"), language="de")


class Lecture:
    """Server of the page of a class, with the classroom behind it."""

    def __init__(self, room: Classroom) -> None:
        class Handler(BaseHTTPRequestHandler):
            def log_message(self, format: str, *args: object) -> None:
                pass

            def reply(self, content: bytes, kind: str = "application/json") -> None:
                self.send_response(200)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(content)))
                self.end_headers()
                self.wfile.write(content)

            def do_GET(self) -> None:
                name = self.path.rpartition("/")[2]
                if name == "question":
                    self.reply(msgspec.json.encode({"question": room.question, "own": room.own("b")}))
                elif name in pages.ASSETS:
                    self.reply((STATIC / name).read_bytes(), pages.ASSETS[name])
                else:
                    self.reply(pages.classroom().encode(), "text/html")

            def do_POST(self) -> None:
                body = msgspec.json.decode(self.rfile.read(int(self.headers["Content-Length"])))
                room.give("b", "address", body["number"], body["given"])
                self.reply(msgspec.json.encode({"own": room.own("b")}))

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_port}/session/class/"
        self._thread = threading.Thread(target=self._server.serve_forever)
        self._thread.start()

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


@pytest.fixture
def room() -> Classroom:
    return Classroom()


@pytest.fixture
def lecture(room: Classroom) -> Iterator[Lecture]:
    served = Lecture(room)
    yield served
    served.close()


def test_a_class_is_answered_by_keyboard(room: Classroom, lecture: Lecture, open_page) -> None:
    room.ask(CURVE)
    page = open_page(lecture.url, viewport={"width": 390, "height": 700})
    page.emulate_media(color_scheme="dark")
    expect(page.locator("#message")).to_have_css("color", "rgb(255, 143, 143)")
    page.emulate_media(color_scheme="light")
    expect(page.locator("#message")).to_have_css("color", "rgb(179, 38, 30)")
    news, content = page.locator("#news"), page.locator("#class")
    expect(news).to_have_text("Draw the force.")
    page.keyboard.press("Tab")
    pen = page.locator("circle")
    expect(pen).to_have_attribute("visibility", "visible")
    left = float(pen.get_attribute("cx"))
    for key in 6 * ["ArrowRight"] + 8 * ["ArrowUp"]:
        page.keyboard.press(key)
    assert float(pen.get_attribute("cx")) > left + 60.0
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    expect(content.get_by_text("Answered. You may change it")).to_be_visible()
    own = room.own("b")
    assert isinstance(own, list)
    assert own == pytest.approx([15.0 + 8 * 0.6] * POINTS)
    expect(page.get_by_role("button", name="Change")).to_be_focused()  # though all of it was drawn anew
    expect(news).to_contain_text("Answered")

    room.ask(CHOICE)
    expect(news).to_have_text("Which?")
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    expect(page.get_by_role("button", name="B more")).to_have_attribute("aria-pressed", "true")
    expect(page.get_by_role("button", name="B more")).to_be_focused()
    room.ask(msgspec.structs.replace(CHOICE, open=False, result="<b>more</b>"))
    expect(news).to_have_text("more")

    room.ask(NUMBER)
    expect(news).to_have_text("How far?")
    # the decimal keypad of an iPhone has no minus
    expect(page.get_by_role("textbox")).not_to_have_attribute("inputmode", re.compile("decimal|numeric"))
    page.get_by_role("textbox").fill("1,000")
    page.keyboard.press("Enter")
    expect(page.locator("#message")).to_have_text("1,000 can be read in two ways: write 1.000 or 1000.")
    page.get_by_role("textbox").fill("−1,5")
    page.keyboard.press("Enter")
    expect(content.get_by_text("Answered. You may change it")).to_be_visible()
    assert room.own("b") == -1.5

    room.ask(GERMAN)
    expect(news).to_have_text("Welche?")
    for part in (news, content.locator("h1"), page.get_by_role("button", name="B mehr")):
        expect(part).to_have_attribute("lang", "de")
    page.get_by_role("button", name="B mehr").click()
    expect(news).to_contain_text("Beantwortet")
    expect(news).to_have_attribute("lang", "de")
    room.ask(msgspec.structs.replace(NUMBER, number=5, language="de"))
    expect(page.get_by_role("button", name="Antworten")).to_be_visible()
    page.get_by_role("textbox").fill("viel")
    page.keyboard.press("Enter")
    expect(page.locator("#message")).to_have_text("Eine Zahl wie 12,5.")
    room.ask(msgspec.structs.replace(CURVE, number=6, language="de", end=2.5))
    expect(content.locator(".ends")).to_have_text("F_n [N]: 0 … 30, über 0 … 2,5 s")
