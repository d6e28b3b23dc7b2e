"""Processes of a shared server that hang, are stopped, or lose their parent: each attack of the red team as a test."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
from contextlib import suppress
from pathlib import Path

import pytest

from app.gateway.server_settings import PageStyle
from app.gateway.session_pool import SessionPool
from app.gateway.visitors import NOBODY, Viewer
from app.gateway.worker import Worker
from app.process import launcher
from app.scenario.data import load, to_toml
from app.workers.fork_server import SESSION
from drivers.visitors import PATIENCE, gone, serving
from drivers.waiting import until

pytestmark = pytest.mark.slow  # servers
HELPER = ("timeit", "-n", "1", "-r", "1", "input()")
SCENARIO = to_toml(load("planar2r-semicircle"))


def test_a_session_that_hangs_is_killed_and_begun_again_and_it_is_said() -> None:
    made = list[Worker]()

    async def launch(scenario: str) -> Worker:
        made.append(await Worker.prepared(scenario, PageStyle(), silence=60.0))
        return made[-1]

    async def check() -> None:
        pool = SessionPool(SCENARIO, launch, 1, None, spare=False)
        session = pool.new()
        pool.want(session)
        try:
            async with asyncio.timeout(PATIENCE):
                while session.phase != "running":
                    await asyncio.sleep(0.05)
                made[0]._silence = 6.0  # of the one that is stopped: the others may be slow
                while made[0]._allowed != 6.0:  # from its next sign of life on
                    await asyncio.sleep(0.05)
                with pool.viewing(session, Viewer(NOBODY, "steer")):
                    os.kill(made[0].process_id, signal.SIGSTOP)
                    while not (session.crashes and session.phase == "running"):
                        await asyncio.sleep(0.05)
            assert "it gave no sign of life for 6 s" in session.notice
            assert not made[0].alive
            assert made[1].alive
        finally:
            await pool.close()

    asyncio.run(check())


def children(process: int) -> list[int]:
    """Of this process, and theirs; one that ends meanwhile has none."""
    found = list[int]()
    with suppress(OSError):
        for task in Path(f"/proc/{process}/task").iterdir():
            with suppress(OSError):
                for number in map(int, (task / "children").read_text().split()):
                    found += [number, *children(number)]
    return found


def test_a_helper_is_in_the_session_of_its_parent_but_not_in_the_group_that_ctrl_c_reaches() -> None:
    helper = launcher.start(*HELPER, niceness=0, stdin=subprocess.PIPE)
    try:
        assert os.getsid(helper.pid) == os.getsid(0)
        assert os.getpgid(helper.pid) == helper.pid
        helper.communicate(b"\n", timeout=PATIENCE)
        assert helper.returncode == 0
    finally:
        helper.kill()


def limits(process: int) -> dict[str, list[str]]:
    """Of what it may have: the soft one and the hard one; none of a process that has ended."""
    try:
        rows = Path(f"/proc/{process}/limits").read_text().splitlines()
    except OSError:
        return {}
    return {row[:26].strip(): row[26:].split()[:2] for row in rows}


def is_session(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/comm").read_text() == f"{SESSION}\n"
    except OSError:  # it has ended
        return False


def limited(process: int) -> bool:
    """Whether memory and open files of a session's process have a limit."""
    has, wanted = limits(process), {"Max data size": "4000000000", "Max open files": "512"}
    return all(has.get(name) == [most, most] for name, most in wanted.items())


def settled(process: int) -> bool:
    """Whether it is past the first steps of all processes of ours, and leaves no core, with links in it."""
    return limits(process).get("Max core file size") == ["0", "0"]


def test_processes_that_are_stopped_do_not_outlive_a_killed_server() -> None:
    with serving("planar2r-semicircle", "--shared", "--max-sessions", "1", lines=2) as server:
        # one that compiles ahead may be there, too
        session = until(lambda: next(filter(is_session, children(server.process.pid)), None), "no session")
        until(lambda: limited(session), "no limits")
        until(lambda: all(map(settled, children(server.process.pid))), "no process has begun")
        started = children(server.process.pid)
        for process in started:
            os.kill(process, signal.SIGSTOP)
        server.process.kill()
        server.process.wait()
        assert all(gone(process) for process in started)
