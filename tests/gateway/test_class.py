"""A class of a session: its link, what it is asked, and its answers on their way to the lecturer."""

from __future__ import annotations

import asyncio
import json
import re
from typing import Any
from xml.etree import ElementTree

import pytest
from aiohttp import ClientWebSocketResponse

from app.access.admission import Names, Tokens
from app.access.classroom import ClassQuestion
from app.access.session_messages import Asks
from app.gateway import pages
from app.gateway.class_pages import GATHERED
from drivers.town import Town, town
from tests.gateway.test_links import FAR, PUBLIC, come_in, cookies
from tests.hostile.test_hostile_visitors import in_a_loop

QUESTION = ClassQuestion(1, "choice", "Which way, <b>then</b>?", options=("there", "back"))


async def asked(lab: Town, question: ClassQuestion | None, number: int = 0) -> None:
    """Let the lecturer ask, and wait until the gateway knows."""
    lab.actors[number].emit(Asks(question))
    while not any(session.classroom.question == question for session in lab.pool.sessions):
        await asyncio.sleep(0.005)


async def class_of(lab: Town, path: str, **headers: str) -> str:
    """Path of the class of a session, as its page shows it."""
    links = (await lab.about(path, **headers))["links"]
    return links["class"].removeprefix("../..")


async def opened(lab: Town) -> tuple[ClientWebSocketResponse, str]:
    """Web socket of a lecturer's page, and the path of the class."""
    lecture = await lab.arrive()
    page = await lab.looked_at(lecture)
    return page, await class_of(lab, lecture)


async def give(lab: Town, path: str, content: Any, **headers: str) -> tuple[int, dict[str, Any]]:
    body = content if isinstance(content, bytes) else json.dumps(content).encode()
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    async with lab.client.post(lab.url(f"{path}answer"), data=body, headers=named) as answer:
        return answer.status, await answer.json() if answer.content_type == "application/json" else {}


async def student(lab: Town, path: str) -> dict[str, str]:
    """Headers of a browser that has opened the page."""
    answer = await lab.ask(path)
    assert answer.status == 200
    assert "class.js" in await answer.text()
    return {"Cookie": cookies(answer)}


async def until_answers(lab: Town, given: list[Any], number: int = 0) -> None:
    """Wait until the lecturer's process has these answers, in any order."""
    while not (answers := lab.actors[number].answers) or sorted(answers[-1].given) != given:
        await asyncio.sleep(0.005)


async def question(lab: Town, path: str, **headers: str) -> dict[str, Any]:
    return await (await lab.ask(f"{path}question", **headers)).json()


@in_a_loop
async def test_a_class_answers_and_the_lecturer_gets_every_answer_once() -> None:
    async with town(classes=True) as lab:
        page, path = await opened(lab)
        one, other = await student(lab, path), await student(lab, path)
        assert (await question(lab, path, **one))["question"] is None
        assert await give(lab, path, {"number": 1, "given": 1}, **one) == (
            409,
            {"refused": "answer: this question is over; allowed: to the present one"},
        )
        await asked(lab, QUESTION)
        assert (await question(lab, path, **one))["question"]["options"] == ["there", "back"]
        assert await give(lab, path, {"number": 1, "given": 1}, **one) == (200, {"own": 1})
        assert await give(lab, path, {"number": 1, "given": 2}, **one) == (200, {"own": 2})
        assert await give(lab, path, {"number": 1, "given": 2}, **other) == (200, {"own": 2})
        await until_answers(lab, [2, 2])
        late = await student(lab, path)  # comes now, and sees the question without an answer; a reload keeps one's own
        assert (await question(lab, path, **late))["own"] is None
        assert (await question(lab, path, **one))["own"] == 2
        await page.close()


@in_a_loop
async def test_hostile_answers_harm_nobody() -> None:
    async with town(classes=True) as lab:
        page, path = await opened(lab)
        one = await student(lab, path)
        await asked(lab, QUESTION)
        for content in (
            b"",
            b"{",
            b"[1]",
            b'"x"',
            b"\xff",
            b'{"\xff": 1}',
            b"[" * 100_000 + b"]" * 100_000,
            b"x" * 60_000,
            b"null",
        ):
            status, answer = await give(lab, path, content, **one)
            assert status == (413 if len(content) > 64 * 1024 else 400)
            assert answer["refused"].startswith("answer: too long; allowed: " if status == 413 else "answer: ")
        for given in (0, 3, "1", None, [1], {"a": 1}, 1e308, 10**400, True):
            assert (await give(lab, path, {"number": 1, "given": given}, **one))[0] == 409
        for number in (0, 2, "1", None, [1], True, 1.0):
            assert (await give(lab, path, {"number": number, "given": 1}, **one))[0] == 409
        assert (await give(lab, path, {"number": 1, "given": 1}))[0] == 409  # without a cookie
        foreign = {**one, "Origin": "http://evil.example"}
        assert (await give(lab, path, {"number": 1, "given": 1}, **foreign))[0] == 403
        assert not lab.actors[0].answers
        assert (await give(lab, path, {"number": 1, "given": 1}, **one))[0] == 200
        await page.close()


@in_a_loop
async def test_the_link_opens_the_class_and_no_session_to_steer() -> None:
    tokens = Tokens()
    async with town(names=PUBLIC, tokens=tokens, classes=True) as lab:
        own = {"Cookie": f"vsmrc-token-{lab.port}={tokens.steer}"}
        lecture = await lab.arrive(**own)
        link = await class_of(lab, lecture, **own)
        path = link.partition("?")[0]
        assert tokens.steer not in link
        assert (await lab.ask(path, **FAR)).status == 403
        guest = {**FAR, "Cookie": await come_in(lab, link)}
        assert (await lab.ask(path, **guest)).status == 200
        assert (await lab.ask(f"{path}question", **guest)).status == 200
        assert (await lab.ask(lecture, **guest)).status == 403
        assert (await lab.ask("/class/nothing/question", **guest)).status == 404


@in_a_loop
async def test_without_classes_there_is_no_link_and_no_page() -> None:
    async with town() as lab:
        lecture = await lab.arrive()
        links = (await lab.about(lecture))["links"]
        assert "class" not in links
        watch = links["watch"].split("/")[-2]
        assert (await lab.ask(f"/class/{watch}/")).status == 404
        assert (await lab.ask(f"/class/{watch}/answer", "POST")).status == 404


@in_a_loop
async def test_the_qr_code_is_a_picture_of_an_address_and_of_nothing_else() -> None:
    async with town(classes=True) as lab:
        lecture = await lab.arrive()
        answer = await lab.ask(f"{lecture}qr?link=http%3A%2F%2F127.0.0.1%2Fclass%2Fx%2F")
        assert (answer.status, answer.content_type) == (200, "image/svg+xml")
        assert ElementTree.fromstring(await answer.read()).tag.endswith("svg")
        for wrong in ("", "javascript:alert(1)", "http://" + "x" * 600):
            assert (await lab.ask(f"{lecture}qr?link={wrong}")).status == 400


@in_a_loop
async def test_a_class_goes_on_when_the_lecturers_process_has_fallen() -> None:
    """It is asked still, its answers count, and the next process gets all of them with the question; without one, that
    is over."""
    async with town(classes=True) as lab:
        page, path = await opened(lab)
        one, other = await student(lab, path), await student(lab, path)
        await asked(lab, QUESTION)
        assert await give(lab, path, {"number": 1, "given": 1}, **one) == (200, {"own": 1})
        await lab.actors[0].end()
        while len(lab.actors) < 2 or lab.actors[1].begun is None:
            await asyncio.sleep(0.01)
        assert lab.actors[1].begun.asked == 1
        assert (await question(lab, path, **one))["own"] == 1
        assert await give(lab, path, {"number": 1, "given": 2}, **other) == (200, {"own": 2})
        lab.actors[1].answers.clear()
        lab.actors[1].emit(Asks(QUESTION))
        while not lab.actors[1].answers:
            await asyncio.sleep(0.005)
        assert lab.actors[1].answers[-1].given == (1, 2)
        await asked(lab, None, number=1)
        assert (await question(lab, path, **one))["question"] is None
        await page.close()


@in_a_loop
@pytest.mark.parametrize("after", [None, ClassQuestion(2, "choice", "And now?", options=("there", "back"))])
async def test_an_answer_that_comes_just_before_the_next_question_is_not_lost(after: ClassQuestion | None) -> None:
    """It was taken, and waits to be handed over with others when the lecturer goes on."""
    async with town(classes=True) as lab:
        page, path = await opened(lab)
        one = await student(lab, path)
        await asked(lab, QUESTION)
        lab.pool.sessions[0].hands_over_soon = True  # as if others had just answered: nothing hands it over
        assert await give(lab, path, {"number": 1, "given": 2}, **one) == (200, {"own": 2})
        await asked(lab, after)
        await asked(lab, QUESTION if after is None else None)
        assert [(answers.number, answers.given) for answers in lab.actors[0].answers] == [(1, (2,))]
        await page.close()


@in_a_loop
async def test_a_browser_that_never_stops_answering_does_not_flood_the_lecturer() -> None:
    async with town(classes=True) as lab:
        page, path = await opened(lab)
        one = await student(lab, path)
        await asked(lab, QUESTION)
        begun = asyncio.get_running_loop().time()
        for k in range(200):
            assert (await give(lab, path, {"number": 1, "given": 1 + k % 2}, **one))[0] == 200
        await until_answers(lab, [2])
        assert len(lab.actors[0].answers) <= 1 + (asyncio.get_running_loop().time() - begun) / GATHERED
        await page.close()


@pytest.mark.slow
@in_a_loop
async def test_thirty_of_a_class_answer_at_once() -> None:
    async with town(names=Names(), classes=True) as lab:
        page, path = await opened(lab)
        students = await asyncio.gather(*(student(lab, path) for _ in range(30)))
        assert len({each["Cookie"] for each in students}) == 30
        await asked(lab, QUESTION)
        answers = await asyncio.gather(
            *(give(lab, path, {"number": 1, "given": 1 + k % 2}, **each) for k, each in enumerate(students))
        )
        assert all(status == 200 for status, _ in answers)
        await until_answers(lab, [1] * 15 + [2] * 15)
        await page.close()


def test_the_page_of_a_class_asks_for_nothing_from_elsewhere() -> None:
    assert not re.findall(r"(?:src|href)=\"(?!\.\./\.\./assets/|data:)", pages.classroom())
    assert "http" not in pages.asset("class.js").decode().replace("http://www.w3.org/2000/svg", "")
