"""`vsmrc serve` for an audience: the real command, its processes, and pages that speak viser's protocol."""

from __future__ import annotations

import http.client
import json
import os
import re
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from app.access.admission import PortTaken
from app.access.rate_limits import ConnectionLimits
from app.dashboard.page import Dashboard
from app.gateway.serve import serve
from app.gateway.server_settings import PageStyle, ServerSettings
from app.gateway.session_store import LINK, SessionStore
from app.scenario.data import load
from app.scenario.errors import ScenarioError
from app.storage.session_index import SESSION
from drivers.viser_protocol import CAMERA
from drivers.visitors import PATIENCE, Server, gone, serving, visiting
from drivers.waiting import until

pytestmark = pytest.mark.slow  # servers

MOTION, IMPEDANCE, PIN = "Mode: Motion", "Mode: Impedance", "Pin this run, to compare it with others"


class Answer(NamedTuple):
    status: int
    headers: http.client.HTTPMessage
    body: str


def ask(port: int, path: str, method: str = "GET", **headers: str) -> Answer:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE)
    try:
        connection.request(method, path, headers={name.replace("_", "-"): value for name, value in headers.items()})
        answer = connection.getresponse()
        return Answer(answer.status, answer.headers, answer.read().decode())
    finally:
        connection.close()


class Link(NamedTuple):
    """A session of one's own, as a visitor of / gets it."""

    port: int
    path: str
    cookie: str = ""

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}{self.path}"

    def about(self) -> dict[str, Any]:
        return json.loads(ask(self.port, f"{self.path}about", Cookie=self.cookie).body)

    def watch(self) -> Link:
        return Link(self.port, urlsplit(self.about()["links"]["watch"]).path.removeprefix("../.."), self.cookie)

    def loaded(self) -> Answer:
        """Its page, once its process runs."""
        until = time.monotonic() + PATIENCE
        while "overlay.js" not in (answer := ask(self.port, self.path, Cookie=self.cookie)).body:
            assert time.monotonic() < until, answer.body
            time.sleep(0.1)
        return answer


def arrive(port: int) -> Link:
    return Link(port, "/" + ask(port, "/").headers["Location"])


@pytest.fixture(scope="module")
def shared() -> Iterator[Server]:
    """Two places, each of which may be looked at again by another test."""
    with serving("--shared", "--max-sessions", "2", lines=2) as server:
        yield server


@pytest.fixture(scope="module")
def link(shared: Server) -> Link:
    """A session that runs."""
    link = arrive(shared.port)
    link.loaded()
    return link


def test_a_visitor_gets_a_session_and_comes_back_to_it(shared: Server, link: Link) -> None:
    first = ask(shared.port, "/")
    cookie = first.headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Lax" in cookie
    again = ask(shared.port, "/", Cookie=cookie.split(";")[0])
    assert again.headers["Location"] == first.headers["Location"] != link.path[1:]
    assert ask(shared.port, link.path[:-1]).headers["Location"] == link.path.split("/")[-2] + "/"
    page = link.loaded()
    assert ask(shared.port, link.path, If_None_Match=page.headers["ETag"]).status == 304
    assert ask(shared.port, "/s/guessed/").status == 404
    # viser's page would take the address of another server from there, and run what that one sends
    assert ask(shared.port, f"{link.path}?websocket=ws://evil.example").headers["Location"] == "./"
    # nor does a picture on a foreign page take up a place
    assert ask(shared.port, "/", Sec_Fetch_Dest="image").status == 403


def test_watching_shows_everything_and_moves_nothing_and_a_copy_is_free(shared: Server, link: Link) -> None:
    watch = link.watch()
    assert watch.path.split("/")[-2] not in link.path
    assert "links" not in watch.about()
    with visiting(link.url) as steering, visiting(watch.url) as watching:
        watching.wait(lambda: "Hybrid position / force" in watching.status)
        for command in (MOTION, IMPEDANCE):
            watching.trigger(command)
        began = watching.t
        watching.wait(lambda: watching.t > began + 0.5)
        assert "Hybrid position / force" in watching.status
        steering.trigger(MOTION)
        watching.wait(lambda: "Motion" in watching.status)
        changed = steering.t
        steering.wait(
            lambda: "Motion" in steering.status and steering.t > changed + 1.5
        )  # the gateway knows it by then
        assert link.about()["viewers"] == 2
    assert ask(shared.port, f"{watch.path}again", "POST").status == 404
    moved = ask(shared.port, f"{watch.path}copy", "POST")
    copy = Link(shared.port, moved.headers["Location"].removeprefix("../.."))
    copy.loaded()
    with visiting(copy.url) as own, visiting(link.url) as theirs:
        own.wait(lambda: "Motion" in own.status)
        own.trigger(IMPEDANCE)
        own.wait(lambda: "Impedance" in own.status)
        theirs.wait(lambda: "Motion" in theirs.status)
        # and there is no third place: who comes now is told so, and how many are before
        late = arrive(shared.port)
        assert "queue" in ask(shared.port, late.path).body
        assert (late.about()["phase"], late.about()["place"]) == ("waiting", 1)
        # a process that is killed takes nobody along, and its session goes on from its last scenario
        began = theirs.t
        others = link.about()["crashes"]
        os.kill(shared.children()[-1], signal.SIGKILL)  # of two places taken, there is no spare
        with pytest.raises(ConnectionClosed, match="1012"):
            own.lose()
        theirs.wait(lambda: theirs.t > began + 1.0)
        assert link.about()["crashes"] == others
    copy.loaded()
    assert copy.about()["crashes"] == 1
    assert "SIGKILL" in copy.about()["told"]
    with visiting(copy.url) as own:
        own.wait(lambda: "Impedance" in own.status)


def test_a_foreign_page_and_a_foreign_name_reach_nothing(shared: Server, link: Link) -> None:
    assert ask(shared.port, "/", Host="evil.example").status == 421
    assert ask(shared.port, f"{link.watch().path}copy", "POST", Origin="http://evil.example").status == 403
    with pytest.raises(InvalidStatus, match="403"), visiting(link.url, origin="http://evil.example"):
        pass
    with visiting(link.url, origin=f"http://127.0.0.1:{shared.port}") as page:
        page.wait(lambda: bool(page.status))


def test_a_path_with_a_line_in_it_leads_to_itself(shared: Server) -> None:
    answer = ask(shared.port, "/%0aSet-Cookie:a?x")
    assert (answer.status, answer.headers["Location"], answer.headers["Set-Cookie"]) == (303, "./%0aSet-Cookie:a", None)


@pytest.mark.parametrize(
    ("what", "reason"),
    [
        (b"garbage", "not a message of the page"),
        (b"\x00" * (ConnectionLimits().message + 1), "a message of 12.0 MB; allowed: 12 MB"),
        ({"type": "FileTransferStartUpload", "size_bytes": 10**9, "part_count": 1, "transfer_uuid": "x"}, "a file of"),
        ([CAMERA] * 4000, "too many messages"),
    ],
)
def test_each_limit_closes_the_connection_with_its_reason(link: Link, what: Any, reason: str) -> None:
    with visiting(link.url) as page:
        with suppress(ConnectionClosed):  # while it is still sending; the reason is then read
            for message in what if isinstance(what, list) else [what]:
                page.send(message)
        with pytest.raises(ConnectionClosed, match=reason):
            page.lose()


def test_without_the_token_nothing_answers_and_each_link_opens_its_own(tmp_path: Path) -> None:
    log = tmp_path / "log"
    with serving("planar2r-semicircle", "--token", "always", "--log-file", str(log), lines=2) as server:
        port, token = server.port, re.search(r"token=(\S+)", server.lines[0])
        watch = re.search(r"(/watch/\S+/)\?token=(\S+)", server.lines[1])
        assert token
        assert watch
        for path in ("/", watch[1], f"{watch[1]}about", "/assets/overlay.js", "/?token=wrong"):
            answer = ask(port, path)
            assert answer.status == 403
            assert "the link with its token" in answer.body
        with pytest.raises(InvalidStatus, match="403"), visiting(f"http://127.0.0.1:{port}{watch[1]}"):
            pass
        assert ask(port, "/", Cookie=f"vsmrc-token-{port}=\xff").status == 403
        lines = log.read_text().splitlines()
        assert len([line for line in lines if 'event="request refused" reason="no token, or a wrong one"' in line]) == 7
        assert not [line for line in lines if "wrong&" in line or token[1] in line]
        steering = ask(port, f"/?token={token[1]}").headers
        watching = ask(port, f"{watch[1]}?token={watch[2]}").headers
        cookies = [headers["Set-Cookie"].split(";")[0] for headers in (steering, watching)]
        assert steering["Location"] == watching["Location"] == "./"
        assert ask(port, "/", Cookie=cookies[1]).status == 403  # who may watch gets no link to steer
        assert ask(port, f"{watch[1]}copy", "POST", Cookie=cookies[1]).status == 403
        session = Link(port, "/" + ask(port, "/", Cookie=cookies[0]).headers["Location"])

        def seen() -> bool:
            with suppress(ConnectionClosed), visiting(session.url, additional_headers={"Cookie": cookies[0]}) as page:
                page.wait(lambda: bool(page.status))
                return True
            return False  # its process is not ready yet

        until(seen)
        # killed in the middle of everything, the server leaves no process behind
        children = server.children()
        assert children
        server.process.kill()
        server.process.wait()
        assert all(gone(child) for child in children)


def pinned_in(folder: Path) -> Path:
    """Once a run has been kept there."""
    until(lambda: (folder / SESSION).exists() and json.loads((folder / SESSION).read_text())["pinned"])
    return folder


def test_links_scenarios_and_pinned_runs_outlive_the_server(tmp_path: Path) -> None:
    arguments = ("planar2r-semicircle", "--shared", "--max-sessions", "1", "--state-dir", str(tmp_path))
    with serving(*arguments, lines=2) as server:
        link = arrive(server.port)
        link.loaded()
        with visiting(link.url) as page:
            page.trigger(IMPEDANCE)
            page.wait(lambda: "Impedance" in page.status)
            page.trigger(PIN)
            page.wait(lambda: "</i> run 1</th>" in page.text)
        pinned_in(tmp_path / "shared" / link.watch().path.split("/")[-2])
        server.process.kill()
        server.process.wait()
    with serving(*arguments, lines=2) as server:
        again = Link(server.port, link.path)
        again.loaded()
        with visiting(again.url) as page:
            page.wait(lambda: "Impedance" in page.status and "</i> run 1</th>" in page.text)
        assert arrive(server.port).path != link.path


def test_a_link_to_a_scenario_of_another_version_shows_the_usual_one_and_says_so(tmp_path: Path) -> None:
    watch = "w" * 22
    SessionStore(tmp_path / "shared").close()
    (tmp_path / "shared" / watch).mkdir(mode=0o700)
    kept = {"name": "n" * 22, "watch": watch, "scenario": "[arm]\nlegs = 2\n"}
    (tmp_path / "shared" / watch / LINK).write_text(json.dumps(kept))
    with serving("planar2r-semicircle", "--shared", "--max-sessions", "1", "--state-dir", str(tmp_path), lines=2) as s:
        link = Link(s.port, f"/s/{kept['name']}/")
        link.loaded()
        with visiting(link.url) as page:
            page.wait(lambda: page.running)
            page.wait(lambda: "the session&#x27;s scenario cannot be read, planar2r-semicircle" in page.text)
            assert "runs in its place: arm: " in page.text
        assert link.about()["crashes"] == 0


def test_one_session_for_all_keeps_its_links_and_offers_what_it_was_at(tmp_path: Path) -> None:
    arguments = ("planar2r-semicircle", "--token", "always", "--state-dir", str(tmp_path))
    paths, offered = list[str](), list[bool]()
    for _ in range(2):
        with serving(*arguments, lines=2) as server:
            cookie = ask(server.port, f"/?{urlsplit(server.url).query}").headers["Set-Cookie"].split(";")[0]
            link = Link(server.port, "/" + ask(server.port, "/", Cookie=cookie).headers["Location"], cookie)
            link.loaded()
            with visiting(link.url, additional_headers={"Cookie": cookie}) as page:
                page.wait(lambda page=page: "Constrained" in page.status)
                offered.append("with a pinned run, saved" in page.text)
                page.trigger(IMPEDANCE)
                page.wait(lambda page=page: "Impedance" in page.status)
                page.trigger(PIN)
            pinned_in(tmp_path / "everyone" / link.watch().path.split("/")[-2])
            paths.append(link.path)
    assert paths[0] == paths[1]
    assert offered == [False, True]


def test_a_dashboard_alone_answers_its_own_pages_only() -> None:
    dashboard = Dashboard(port=0)
    try:
        url = dashboard.url
        assert ask(dashboard.port, "/").status == 200
        assert ask(dashboard.port, "/", Host="evil.example").status == 421
        assert ask(dashboard.port, "/?websocket=ws://evil.example").headers["Location"] == "/"
        with pytest.raises(InvalidStatus, match="403"), visiting(url, origin="http://evil.example"):
            pass
        with visiting(url, origin=url) as page:
            page.send(b"garbage")  # is left out
            page.wait(lambda: bool(page.html))
    finally:
        dashboard.close()


@pytest.mark.parametrize(
    ("server_settings", "message"),
    [
        (ServerSettings("0.0.0.0", token="never"), "--token: never, with --host 0.0.0.0; allowed: only with 127.0.0.1"),
        (ServerSettings(shared=True, capacity=0), "--max-sessions: 0; allowed: 1 or more"),
        (ServerSettings(shared=True, of_one_address=0), "--per-address: 0; allowed: 1 or more"),
        (ServerSettings(shared=True, idle_minutes=-1.0), "--idle-minutes: -1; allowed: more than 0"),
        (ServerSettings(origins=("lab.example.org",)), "--origin 'lab.example.org'; allowed: scheme and name"),
    ],
)
def test_settings_that_make_no_sense_are_refused(server_settings: ServerSettings, message: str) -> None:
    assert server_settings.open
    with pytest.raises(ScenarioError, match=re.escape(message)):
        serve(load("ur5-hybrid"), PageStyle(), server_settings, None)


def test_an_address_in_use_is_said() -> None:
    with socket.create_server(("127.0.0.1", 0)) as busy:
        port = busy.getsockname()[1]
        with pytest.raises(PortTaken, match=f"port {port} of 127.0.0.1 cannot be used"):
            serve(load("ur5-hybrid"), PageStyle(), ServerSettings(shared=True, port=port), None)
