"""Compiling ahead: for every arm and contact, once, and never beyond the program that began it."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import NoReturn

import pytest

from app.process import kernel_cache, launcher, precompile
from app.simulation.assembly import assemble
from app.workers.precompile import to_compile
from drivers.waiting import until
from environments.catalogue import CATALOGUE

pytestmark = pytest.mark.slow  # processes of its own


def test_every_number_of_joints_meets_every_contact_with_kernels_of_its_own() -> None:
    systems = [assemble(scenario) for scenario in to_compile(None)]
    compiled = {(system.robot.n, system.scenario.contact.kind) for system in systems}
    joints = {len(entry.rotor_inertia) for entry in CATALOGUE.values()}
    assert compiled == {(n, kind) for n in joints for kind in ("elastic", "mass-damper-spring", "rigid", "free")}


def test_it_ends_with_the_program_that_began_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(kernel_cache.VARIABLE, str(tmp_path))  # without any kernel it has minutes of work
    process = precompile.start()
    assert process is not None
    assert process.stdin is not None
    process.stdin.close()
    until(lambda: process.returncode is not None)  # it is set without a call of this test: no zombie remains
    assert process.returncode == 0
    assert not precompile.mark().exists()


def test_without_room_for_a_process_the_server_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> NoReturn:
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr(precompile, "mark", lambda: tmp_path / "complete")
    monkeypatch.setattr(launcher, "start", full)
    assert precompile.start() is None


def test_it_is_done_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(precompile, "mark", lambda: tmp_path / "complete")
    (tmp_path / "complete").touch()
    assert precompile.start() is None
