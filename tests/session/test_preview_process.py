"""The process that computes previews: it answers the newest request only, is started anew, and ends with its asker."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from multiprocessing import Pipe
from multiprocessing.connection import Connection

import msgspec
import numpy as np
import pytest

from app.scenario.data import edited, shipped
from app.session.preview_client import Previewer
from app.session.preview_messages import Hurry, Preview, PreviewDone, PreviewRefusal, PreviewRequest
from app.workers.preview import serve
from drivers.waiting import PATIENCE, until
from tests.support.previews import preview_metrics, running

pytestmark = pytest.mark.slow  # processes of its own


@pytest.fixture(scope="module")
def one_previewer() -> Iterator[Previewer]:
    previewer = Previewer()
    yield previewer
    previewer.close()


@pytest.fixture
def previewer(one_previewer: Previewer) -> Previewer:
    """Previewer that has no question, with the process of the tests before."""
    one_previewer.drop()
    until(lambda: one_previewer.idle)
    return one_previewer


def whole(previewer: Previewer) -> Preview | None:
    newest = previewer.newest
    return newest if isinstance(newest, Preview) and newest.whole else None


def test_the_process_answers_the_newest_question_only(previewer: Previewer) -> None:
    loop = running(shipped()["ur5-hybrid"])
    state = loop.state.copy()
    for force in range(21, 61):
        previewer.ask(state, edited(state.scenario, "force.value", float(force)), 0.3)
    answer = until(lambda: whole(previewer) if previewer.idle else None)
    assert answer.scenario.force.value == 60.0
    assert answer.ahead[-1] > 0.29
    loop.edit(answer.scenario)
    for _ in range(300):
        loop.step()
    really = loop.recording.signals(("t", "F_c"), state.t)
    rows = np.searchsorted(really["t"], answer.signals["t"])
    assert len(rows) > 100
    # by rounding where the process computes with the compiled engine
    np.testing.assert_allclose(answer.signals["F_c"], really["F_c"][rows], rtol=1e-9)


def test_a_question_that_only_time_has_changed_gives_way_at_once() -> None:
    state = running(shipped()["ur5-hybrid"]).state.copy()
    ours, theirs = Pipe()
    with ours, theirs:
        for message in (
            PreviewRequest(1, state, state.scenario, 0.05, partial=False),
            Hurry(),
            PreviewRequest(2, state, state.scenario, 0.05),
        ):
            ours.send(message)
        answering = threading.Thread(target=answer_all, args=(theirs,))
        answering.start()
        received = [ours.recv()]
        while not (isinstance(received[-1], Preview) and received[-1].whole):
            received.append(ours.recv())
    answering.join()
    assert isinstance(received[0], PreviewDone)
    assert {message.number for message in received[1:] if isinstance(message, Preview)} == {2}


def answer_all(asker: Connection) -> None:
    with contextlib.suppress(EOFError, OSError):
        serve(asker)


def test_the_running_scenario_is_computed_for_comparison_and_once(previewer: Previewer) -> None:
    state = running(shipped()["ur5-hybrid"]).state.copy()
    for force in (30.0, 40.0):
        previewer.ask(state, edited(state.scenario, "force.value", force), 0.5, partial=False, compared=True)
        answer = until(lambda force=force: compared(previewer, force))
        today = preview_metrics(PreviewRequest(1, state, state.scenario, 0.5))
        assert answer.today is not None
        for figure, value in msgspec.structs.asdict(today).items():
            found = getattr(answer.today, figure)
            assert found == value if value is None else found == pytest.approx(value, rel=1e-5, abs=1e-9), figure
        assert answer.metrics.torque_largest != pytest.approx(today.torque_largest, rel=1e-3)


def compared(previewer: Previewer, force: float) -> Preview | None:
    newest = whole(previewer)
    return newest if newest is not None and newest.today and newest.scenario.force.value == force else None


def test_answers_on_the_way_come_first_and_a_dropped_one_never(previewer: Previewer) -> None:
    state = running(shipped()["ur5-hybrid"]).state.copy()
    changed = edited(state.scenario, "force.value", 30.0)
    previewer.ask(state, changed, 20.0)
    first = until(lambda: previewer.newest)
    assert isinstance(first, Preview)
    assert not first.whole
    previewer.drop()
    until(lambda: previewer.idle)
    assert previewer.newest is None


def test_a_refused_scenario_is_a_sentence_and_the_next_question_is_answered(previewer: Previewer) -> None:
    state = running(shipped()["ur5-hybrid"], 5).state.copy()
    previewer.ask(state, edited(state.scenario, "target_model.M_m", [0.0] * 6), 0.1)
    refusal = until(lambda: previewer.newest)
    assert isinstance(refusal, PreviewRefusal)
    assert "M_m" in refusal.sentence
    previewer.ask(state, state.scenario, 0.1)
    assert until(lambda: whole(previewer)).scenario == state.scenario


def test_a_killed_process_is_said_and_started_anew(previewer: Previewer) -> None:
    state = running(shipped()["ur5-hybrid"], 5).state.copy()
    previewer.ask(state, state.scenario, 0.05)
    until(lambda: whole(previewer))
    os.kill(previewer.process_id or 0, signal.SIGKILL)
    assert "-9" in until(lambda: previewer.failure)
    previewer.ask(state, state.scenario, 0.05)
    until(lambda: whole(previewer))
    assert previewer.failure is None


def test_closing_leaves_no_process_behind() -> None:
    before = set(threading.enumerate())
    previewer = Previewer()
    state = running(shipped()["ur5-hybrid"], 5).state.copy()
    previewer.ask(state, state.scenario, 20.0)
    until(lambda: previewer.newest)
    process = previewer.process_id
    assert process is not None
    previewer.close()
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
    until(lambda: not [each for each in threading.enumerate() if each.name == "previews" and each not in before])


def test_the_process_ends_when_its_asker_is_killed() -> None:
    program = """
import os, signal, time
from app.simulation.closed_loop import ClosedLoop
from app.session.preview_client import Previewer
from app.scenario.data import shipped
previewer = Previewer()
state = ClosedLoop.from_scenario(shipped()["ur5-hybrid"]).state.copy()
previewer.ask(state, state.scenario, 20.0)
while previewer.newest is None:
    time.sleep(0.01)
os.kill(os.getpid(), signal.SIGKILL)
"""
    # the preview's process has inherited the pipe: the run returns when both have let go of it
    killed = subprocess.run([sys.executable, "-c", program], stdout=subprocess.PIPE, timeout=PATIENCE, check=False)
    assert killed.returncode == -signal.SIGKILL


def test_a_closed_previewer_starts_nothing() -> None:
    previewer = Previewer()
    previewer.close()
    previewer.warm_up(running(shipped()["ur5-hybrid"], 1).state.copy())
    assert previewer.process_id is None
