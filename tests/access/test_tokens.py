"""Where a token comes from, when one is asked for, and what it opens on a server of one's own."""

from __future__ import annotations

import os
import re
import secrets
from pathlib import Path

import pytest
from websockets.exceptions import InvalidStatus

from app.access.admission import Tokens
from app.access.given_token import VARIABLE, given_token
from app.dashboard.page import Dashboard
from app.gateway.serve import serve
from app.gateway.server_settings import PageStyle, ServerSettings
from app.process import other_users
from app.scenario.data import load
from app.scenario.errors import ScenarioError
from drivers.visitors import serving, visiting
from tests.gateway.test_gateway import ask

pytestmark = pytest.mark.slow  # servers

OWN = secrets.token_urlsafe()


def test_a_token_from_a_file_or_the_environment_and_no_other_process_gets_it(tmp_path: Path) -> None:
    (file := tmp_path / "token").write_text(f"{OWN}\n")
    environment = {VARIABLE: "another" * 5}
    assert given_token(file, environment) == OWN
    assert environment == {}
    assert given_token(None, {VARIABLE: OWN}) == OWN
    assert given_token(None, {}) is None


@pytest.mark.parametrize("text", ["", "short", "with spaces in it, of some length", "x" * 300, "ümlaute" * 5])
def test_what_is_no_token_is_refused_and_not_said(text: str, tmp_path: Path) -> None:
    (file := tmp_path / "token").write_text(text)
    for given in ((file, {}), (None, {VARIABLE: text})):
        with pytest.raises(ScenarioError, match="characters; allowed: 22 to 200 of the characters A-Z") as caught:
            given_token(*given)
        assert not text or text not in str(caught.value)
    os.mkfifo(tmp_path / "pipe")
    for no_file in (tmp_path / "none", tmp_path / "pipe", tmp_path):
        with pytest.raises(ScenarioError, match=r"--token-file .*: cannot be read"):
            given_token(no_file, {})


def test_the_token_to_watch_follows_from_a_given_one_and_a_restart_keeps_both() -> None:
    tokens = Tokens.given(OWN)
    assert tokens == Tokens.given(OWN)
    assert tokens.watch != Tokens.given(OWN[:-1] + "x").watch
    assert (tokens.opens(OWN), tokens.opens(tokens.watch)) == ("steer", "watch")
    assert OWN not in repr(tokens) + repr(ServerSettings(given=OWN))


def test_a_token_is_asked_for_wherever_others_can_come() -> None:
    asked = [
        ServerSettings("0.0.0.0"), ServerSettings(token="always"), ServerSettings(origins=("https://lab.example.org",)),
        ServerSettings(crowded=True), ServerSettings(shared=True, crowded=True), ServerSettings(given=OWN),
    ]  # fmt: skip
    assert all(server_settings.new_tokens() for server_settings in asked)
    assert not any(
        server_settings.new_tokens()
        for server_settings in (ServerSettings(), ServerSettings(crowded=True, token="never"))
    )
    with pytest.raises(ScenarioError, match="--token: never, with a token given; allowed: auto, always"):
        serve(load("ur5-hybrid"), PageStyle(), ServerSettings(token="never", given=OWN), None)


def test_who_else_can_use_the_machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    accounts = [
        "me:1000:bash",
        "you:1001:zsh",
        "daemon:2:bash",
        "kiosk:1002:nologin",
        "nobody:65534:bash",
        "they:1003:",
    ]
    entries = [
        other_users.pwd.struct_passwd((name, "x", int(uid), int(uid), "", "/", shell and f"/usr/bin/{shell}"))
        for name, uid, shell in (account.split(":") for account in accounts)
    ]
    monkeypatch.setattr(other_users.pwd, "getpwall", lambda: entries)
    monkeypatch.setattr(other_users, "Path", lambda _: tmp_path)
    monkeypatch.setattr(other_users.os, "getuid", lambda: 1000)
    assert other_users.other_people() == ["they", "you"]  # without a shell it is /bin/sh
    if os.geteuid() == 0:
        (tmp_path / "17").mkdir()
        os.chown(tmp_path / "17", 2000, 2000)
        assert other_users.other_people() == ["they", "uid 2000", "you"]


def test_ones_own_server_opens_to_who_has_the_token() -> None:
    tokens = Tokens()
    dashboard = Dashboard(port=0, tokens=tokens)
    try:
        assert dashboard.link == f"{dashboard.url}/?token={tokens.steer}"
        for path in ("/", "/?token=wrong", f"/?token={tokens.watch}", "/anything"):
            assert ask(dashboard.port, path).status == 403
        for shown in ({}, {"Cookie": f"vsmrc-token-{dashboard.port}=wrong"}):
            with pytest.raises(InvalidStatus, match="403"), visiting(dashboard.url, additional_headers=shown):
                pass
        entered = ask(dashboard.port, f"/?token={tokens.steer}")
        assert (entered.status, entered.headers["Location"]) == (303, "/")
        assert "HttpOnly; SameSite=Lax" in entered.headers["Set-Cookie"]
        cookie = {"Cookie": entered.headers["Set-Cookie"].split(";")[0]}
        assert ask(dashboard.port, "/", **cookie).status == 200
        with visiting(dashboard.url, additional_headers=cookie) as page:
            page.wait(lambda: bool(page.html))
    finally:
        dashboard.close()


def test_a_given_token_opens_the_server_and_is_neither_printed_nor_inherited(tmp_path: Path) -> None:
    (file := tmp_path / "token").write_text(OWN)
    with serving("planar2r-semicircle", "--token-file", str(file), lines=2) as server:
        assert OWN not in "".join(server.lines)
        assert Tokens.given(OWN).watch not in "".join(server.lines)
        watch = re.search(r"(/watch/\S+/)\?", server.lines[1])
        assert watch is not None
        assert ask(server.port, "/").status == 403
        assert ask(server.port, f"/?token={OWN}").status == 303
        assert ask(server.port, f"{watch[1]}?token={Tokens.given(OWN).watch}").status == 303
