"""Benchmark of a class: how soon its answers are shown, and whether the lecturer's loop keeps its pace meanwhile.

`python -m benchmarks.classroom`: a server `vsmrc serve --shared --class`, a lecturer's page without a browser, and
students that ask and answer as their pages do, once a second each.
"""

from __future__ import annotations

import http.client
import json
import random
import threading
import time
from statistics import median
from urllib.parse import urlsplit

import tyro

from benchmarks.sessions import arrived
from drivers.visitors import PATIENCE, serving, visiting

ROUNDS = 5


class Student(threading.Thread):
    """Student of a class: looks for a question once a second, and answers each question once, a little later."""

    def __init__(self, port: int, path: str) -> None:
        super().__init__(daemon=True)
        self._connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE)
        self._path, self._answered = path, 0
        self.gave: list[float] = []
        self.seen: list[float] = []
        self._cookie = ""
        self._cookie = (self._ask("GET", "")[1].get("Set-Cookie") or "").partition(";")[0]

    def run(self) -> None:
        while True:
            question = json.loads(self._ask("GET", "question")[0])["question"]
            if question is not None and question["number"] > self._answered:
                self.seen.append(time.perf_counter())
                time.sleep(random.uniform(0.0, 2.0))
                body = json.dumps({"number": question["number"], "given": random.uniform(0.0, 50.0)})
                self._ask("POST", "answer", body)
                self.gave.append(time.perf_counter())
                self._answered = question["number"]
            time.sleep(random.uniform(0.9, 1.1))

    def _ask(self, method: str, path: str, body: str | None = None) -> tuple[bytes, http.client.HTTPMessage]:
        headers = {"Cookie": self._cookie} if self._cookie else {}
        try:
            self._connection.request(method, self._path + path, body, headers)
            answer = self._connection.getresponse()
        except ConnectionError:  # tries again as a browser does, since the server may have closed an idle connection
            self._connection.close()
            self._connection.request(method, self._path + path, body, headers)
            answer = self._connection.getresponse()
        return answer.read(), answer.headers


def main(*, students: int = 30) -> None:
    """Measure how soon a class's answers are shown, and the pace of the lecturer's loop.

    Args:
        students: size of the class
    """
    with serving("--shared", "--class", "--max-sessions", "1", lines=2) as server:
        link = arrived(server.port)
        with visiting(link) as page:
            page.wait(lambda: page.running)
            each = [Student(server.port, _class_of(server.port, link)) for _ in range(students)]
            for student in each:
                student.start()
            page.press("Begin")
            page.trigger("Lesson: next step")
            page.wait(lambda: 'data-step="2"' in page.text)
            reached, shown, first, since = [], [], time.perf_counter(), page.t
            for number in range(ROUNDS):
                began = time.perf_counter()
                page.press("Ask the class")
                expected = f'data-asked="{number + 1}"><b>{students} answers'
                page.wait(lambda expected=expected: expected in page.text)
                ended = time.perf_counter()
                shown.append(ended - max(student.gave[number] for student in each))
                reached += [student.seen[number] - began for student in each]
            pace = (page.t - since) / (time.perf_counter() - first)
        print(f"{students} students, {ROUNDS} questions")
        print(f"a question reaches them after {median(reached):.2f} s (median), {max(reached):.2f} s (last)")
        delay = f"after {median(shown):.2f} s (median), {max(shown):.2f} s (largest)"
        print(f"the last answer is shown to the lecturer {delay}")
        print(f"the loop's pace meanwhile: {pace:.3f} times real time")


def _class_of(port: int, link: str) -> str:
    """Path of a session's class. link: of the session's page, which shows the class's link."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE)
    connection.request("GET", f"{urlsplit(link).path}about")
    links = json.loads(connection.getresponse().read())["links"]
    return links["class"].removeprefix("../..").partition("?")[0]


if __name__ == "__main__":
    tyro.cli(main)
