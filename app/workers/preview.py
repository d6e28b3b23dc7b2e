"""Process that answers what-if questions: `python -m app.workers.preview FD`.

Started by `app.session.preview_client`; it ends when the other end of the connection does.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection

import structlog

from app.process import precompile
from app.process.log import configure_as_parent
from app.scenario.schema import ScenarioError
from app.session.preview import Done, Figures, Foresight, Outlook, Question, Refusal
from app.simulation.engines import Engine
from app.simulation.search_memory import Memory
from app.simulation.system import System
from app.storage.constants_store import kept_memory

log = structlog.get_logger()

DRAWING = 0.06  # s between two answers on the way: every one is drawn
SOON = 0.06  # s of work left, for the sake of which an answer is not given up any more
NICENESS = 10  # the running loop comes first


@dataclass
class _Known:
    """What the next answer may reuse.
    system: of the running scenario.
    today: figures of a question about the running scenario; they count for `horizon` s."""

    system: System | None = None
    question: Question | None = None
    today: Figures | None = None

    def figures_for(self, question: Question) -> Figures | None:
        """Figures of this question about the running scenario; None where they are not known."""
        known = self.question
        if known is None or (known.horizon, known.push) != (question.horizon, question.push):
            return None
        passed = question.state.t - known.state.t
        return self.today if 0.0 <= passed < known.horizon and known.scenario == question.scenario else None


def serve(asker: Connection) -> None:
    """Answer one question at a time. Raises EOFError when the asker has gone."""
    known, memory = _Known(), kept_memory()
    while True:
        question = asker.recv()
        if isinstance(question, Question):  # a Hurry here was meant for the question before
            _answer(question, asker, known, memory)
            asker.send(Done())


def _answer(question: Question, asker: Connection, known: _Known, memory: Memory) -> None:
    try:
        foresight = Foresight(question, known.system, memory, _engine())
        known.system = foresight.base
        today = known.figures_for(foresight.unchanged)
        if _look_ahead(foresight, asker, today) and question.compared and today is None:
            _compare(foresight, asker, known, memory)
    except (ScenarioError, ArithmeticError, ValueError) as error:
        asker.send(Refusal(question.number, str(error)))
    except (EOFError, ConnectionError):
        raise
    except Exception as error:  # the process's last resort: report it, and be ready for the next question
        log.exception("fault", stage="a preview")
        known.system = None
        asker.send(Refusal(question.number, f"internal error: {error}"))


def _engine() -> Engine:
    """The compiled engine once its kernels are in the cache: nobody waits for them here."""
    return "compiled" if precompile.mark().exists() else "pinocchio"


def _look_ahead(foresight: Foresight, asker: Connection, today: Figures | None) -> bool:
    """Answer, and on the way where that is wanted. Whether the answer is whole: a newer question can overtake it."""
    owed = foresight.question.partial
    began = drawn = time.perf_counter()
    while foresight.share < 1.0:
        foresight.advance(foresight.batch)
        now, share = time.perf_counter(), foresight.share
        left = (now - began) * (1.0 - share) / share
        if left > SOON and not owed and asker.poll():
            return False
        if foresight.question.partial and now - drawn > DRAWING:
            asker.send(foresight.outlook(today))
            owed, drawn = False, now
    asker.send(foresight.outlook(today))
    return True


def _compare(foresight: Foresight, asker: Connection, known: _Known, memory: Memory) -> None:
    """Answer once more, with the figures of the running scenario. Not given up for a newer question: all that follow
    while the slider is held have the same figures beside theirs."""
    question = foresight.unchanged
    running = Foresight(question, known.system, memory, _engine())
    while running.share < 1.0:
        running.advance(running.batch)
    if isinstance(outlook := running.outlook(), Outlook):
        known.question, known.today = question, outlook.figures
        asker.send(foresight.outlook(outlook.figures))


def run(asker: Connection) -> None:
    """Answer questions at a lower priority than the asker's, until it has gone."""
    os.nice(NICENESS)
    with asker:
        try:
            serve(asker)
        except (EOFError, ConnectionError):
            log.debug("asker gone")


if __name__ == "__main__":
    configure_as_parent()
    run(Connection(int(sys.argv[1])))
