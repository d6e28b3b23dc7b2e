"""Processes of a shared server that hang, are stopped, or lose their parent: each attack of the red team as a test."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
from pathlib import Path

from app import child
from app.gateway.invitation import Look
from app.gateway.sessions import House
from app.gateway.visitors import NOBODY, Viewer
from app.gateway.worker import Worker
from app.scenario_data import load, to_toml
from tests.visitors import PATIENCE, gone, serving
from tests.waiting import until

HELPER = ("timeit", "-n", "1", "-r", "1", "input()")
SCENARIO = to_toml(load("planar2r-semicircle"))


def test_a_session_that_hangs_is_killed_and_begun_again_and_it_is_said() -> None:
    made = list[Worker]()

    async def launch(scenario: str) -> Worker:
        made.append(await Worker.prepared(scenario, Look(), silence=6.0))
        return made[-1]

    async def check() -> None:
        house = House(SCENARIO, launch, 1, None, spare=False)
        session = house.new()
        house.want(session)
        try:
            async with asyncio.timeout(PATIENCE):
                while session.phase != "running":
                    await asyncio.sleep(0.05)
                with house.viewing(session, Viewer(NOBODY, "steer")):
                    os.kill(made[0].process_id, signal.SIGSTOP)
                    while not (session.crashes and session.phase == "running"):
                        await asyncio.sleep(0.05)
            assert "it gave no sign of life for 6 s" in session.told
            assert not made[0].alive
            assert made[1].alive
        finally:
            await house.close()

    asyncio.run(check())


def children(process: int) -> list[int]:
    """Of this process, and theirs."""
    found = list[int]()
    for task in Path(f"/proc/{process}/task").iterdir():
        for number in map(int, (task / "children").read_text().split()):
            found += [number, *children(number)]
    return found


def test_a_helper_is_in_the_session_of_its_parent_but_not_in_the_group_that_ctrl_c_reaches() -> None:
    helper = child.start(*HELPER, stdin=subprocess.PIPE)
    try:
        assert os.getsid(helper.pid) == os.getsid(0)
        assert os.getpgid(helper.pid) == helper.pid
        helper.communicate(b"\n", timeout=PATIENCE)
        assert helper.returncode == 0
    finally:
        helper.kill()


def limited(process: int) -> bool:
    """Whether memory and open files of a session's process have a limit, and it leaves no core, with links in it."""
    rows = {row[:26].strip(): row[26:].split()[:2] for row in Path(f"/proc/{process}/limits").read_text().splitlines()}
    wanted = {"Max data size": "4000000000", "Max open files": "512", "Max core file size": "0"}
    return all(rows[name] == [most, most] for name, most in wanted.items())


def test_processes_that_are_stopped_do_not_outlive_a_killed_server() -> None:
    with serving("planar2r-semicircle", "--shared", "--max-sessions", "1", lines=2) as server:
        started = until(lambda: children(server.process.pid))
        until(lambda: limited(started[-1]), "no limits")
        for process in started:
            os.kill(process, signal.SIGSTOP)
        server.process.kill()
        server.process.wait()
        assert all(gone(process, 20.0) for process in started)
