"""Autosave where an index cannot be written, or could not be read again."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from app.process.atomic_write import write_whole
from app.scenario.data import edited, shipped
from app.scenario.schema import Scenario
from app.session import autosave
from app.session.autosave import StateFolder
from app.session.timeline import Pinned, Timeline
from app.simulation.closed_loop import ClosedLoop
from app.storage.session_index import OFFER, SESSION

SCENARIO = shipped()["planar2r-semicircle"]


def layer(thickness: float) -> Scenario:
    return edited(SCENARIO, "controller.layer", thickness)


@pytest.fixture(scope="module")
def pinned() -> tuple[Pinned, ...]:
    line = Timeline(ClosedLoop.from_scenario(SCENARIO))
    for _ in range(2):
        for _ in range(20):
            line.step()
        line.pin()
    return line.pinned


def runs(folder: Path) -> list[Path]:
    return sorted(folder.glob("run-*"))


def without_room_for_an_index(path: Path, *arguments: Any, **options: Any) -> None:
    if path.name == SESSION:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    write_whole(path, *arguments, **options)


def test_runs_are_written_once_however_often_their_index_cannot_be(
    tmp_path: Path, pinned: tuple[Pinned, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    with closing(StateFolder(tmp_path)) as folder:
        folder.save(layer(0.01), pinned[:1])
        indexed, before = runs(tmp_path), (tmp_path / SESSION).read_bytes()
        with monkeypatch.context() as full:
            full.setattr(autosave, "write_whole", without_room_for_an_index)
            for thickness in (0.02, 0.03, 0.04):
                with pytest.raises(OSError, match="No space left"):
                    folder.save(layer(thickness), pinned[1:])
                assert len(runs(tmp_path)) == 2
            written = set(runs(tmp_path)) - set(indexed)
            with pytest.raises(OSError, match="No space left"):
                folder.save(layer(0.05), ())
            assert runs(tmp_path) == indexed  # what nothing names makes room
            assert (tmp_path / SESSION).read_bytes() == before
        folder.save(layer(0.02), pinned[1:])
        assert len(runs(tmp_path)) == 1
        assert not written & set(runs(tmp_path))
    with closing(StateFolder(tmp_path)) as later:
        offer = later.offer()
        assert offer is not None
        assert (offer.scenario, [run.number for run in offer.runs]) == (layer(0.02), [2])


def test_an_edit_is_saved_before_a_run_that_takes_its_time(
    tmp_path: Path, pinned: tuple[Pinned, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A server that is ended while it writes the run has the scenario, and the runs of before."""
    with closing(StateFolder(tmp_path)) as folder:
        folder.save(layer(0.01), pinned[:1])

        def ended(path: Path, *arguments: Any, **options: Any) -> None:
            if path.name != SESSION:
                raise KeyboardInterrupt
            write_whole(path, *arguments, **options)

        monkeypatch.setattr(autosave, "write_whole", ended)
        with pytest.raises(KeyboardInterrupt):
            folder.save(layer(0.02), pinned)
    with closing(StateFolder(tmp_path)) as later:
        offer = later.offer()
        assert offer is not None
        assert (offer.scenario, [run.number for run in offer.runs]) == (layer(0.02), [1])


def faulty(from_toml: Callable[[str], Scenario]) -> Callable[[str], Scenario]:
    """Reader of scenarios that refuses one that this process has."""

    def refuse(text: str) -> Scenario:
        scenario = from_toml(text)
        if scenario == layer(0.02):
            raise autosave.ScenarioError("truth.push_start: 36010 s; allowed: up to 36000 s")
        return scenario

    return refuse


def test_a_session_is_not_set_aside_by_the_process_that_has_written_it(
    tmp_path: Path, pinned: tuple[Pinned, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(autosave, "from_toml", faulty(autosave.from_toml))
    with closing(StateFolder(tmp_path)) as folder:
        folder.save(layer(0.02), pinned)
        assert len(runs(tmp_path)) == 2
        assert folder.problem == ""
        assert {file.name for file in tmp_path.iterdir()} >= {SESSION}
        folder.save(layer(0.03), pinned)
        folder.refuse_offer()
    with closing(StateFolder(tmp_path)) as later:
        assert later.problem == ""
        assert (tmp_path / OFFER).exists()
        assert len(runs(tmp_path)) == 2


def test_files_that_another_thread_is_writing_stay_and_those_of_a_killed_process_go(tmp_path: Path) -> None:
    left, written = tmp_path / ".class.json.1", tmp_path / ".lessons.json.2"
    left.write_bytes(b"")
    with closing(StateFolder(tmp_path)) as folder:
        assert not left.exists()
        written.write_bytes(b"")
        folder.save(layer(0.01), ())
        folder.refuse_offer()
        assert written.exists()
