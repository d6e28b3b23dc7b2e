"""Processes of a shared server that hang, are stopped, or lose their parent: each attack of the red team as a test."""

from __future__ import annotations

import asyncio
import os
import signal

from app.gateway.invitation import Look
from app.gateway.sessions import House
from app.gateway.visitors import NOBODY, Viewer
from app.gateway.worker import Worker
from app.scenario_data import load, to_toml
from tests.visitors import PATIENCE

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
