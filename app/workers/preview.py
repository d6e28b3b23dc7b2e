"""Process that answers what-if questions: `python -m app.workers.preview FD`.

Started by `app.session.preview_client`; it ends when the other end of the connection does.
"""

from __future__ import annotations

import os
import sys
import time
from multiprocessing.connection import Connection

import structlog

from app.process.log import configure_as_parent
from app.scenario.schema import ScenarioError
from app.session.preview import Done, Foresight, Question, Refusal
from app.simulation.search_memory import Memory
from app.simulation.system import System
from app.storage.constants_store import kept_memory

log = structlog.get_logger()

DRAWING = 0.06  # s between two answers on the way: every one is drawn
SOON = 0.06  # s of work left, for the sake of which an answer is not given up any more
LOOK = 25  # control periods between two looks at the clock and at the connection
NICENESS = 10  # the running loop comes first


def serve(asker: Connection) -> None:
    """Answer one question at a time. Raises EOFError when the asker has gone."""
    previous: System | None = None
    memory = kept_memory()
    while True:
        question = asker.recv()
        if isinstance(question, Question):  # a Hurry here was meant for the question before
            previous = _answer(question, asker, previous, memory)
            asker.send(Done())


def _answer(question: Question, asker: Connection, previous: System | None, memory: Memory) -> System | None:
    """Answer a question; returns the system that the next answer may reuse."""
    try:
        foresight = Foresight(question, previous, memory)
        _look_ahead(foresight, asker)
    except (ScenarioError, ArithmeticError, ValueError) as error:
        asker.send(Refusal(question.number, str(error)))
        return previous
    except (EOFError, ConnectionError):
        raise
    except Exception as error:  # the process's last resort: report it, and be ready for the next question
        log.exception("fault", stage="a preview")
        asker.send(Refusal(question.number, f"internal error: {error}"))
        return None
    return foresight.base


def _look_ahead(foresight: Foresight, asker: Connection) -> None:
    owed = foresight.question.partial
    began = drawn = time.perf_counter()
    while foresight.share < 1.0:
        foresight.advance(LOOK)
        now, share = time.perf_counter(), foresight.share
        left = (now - began) * (1.0 - share) / share
        if left > SOON and not owed and asker.poll():
            return
        if foresight.question.partial and now - drawn > DRAWING:
            asker.send(foresight.outlook())
            owed, drawn = False, now
    asker.send(foresight.outlook())


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
