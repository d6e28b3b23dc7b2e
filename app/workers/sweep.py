"""Process that computes a sweep or a search for gains for the page: `python -m app.workers.sweep FD`, started by
`app.sweep.background`."""

from __future__ import annotations

import contextlib
import sys
from multiprocessing.connection import Connection

import structlog

from app.process import slots
from app.process.log import configure_as_parent
from app.scenario.errors import ScenarioError
from app.sweep import background
from app.sweep.background import Begun, ComputeRequest, SweepDone, SweepFailed, Waiting
from app.tune import background as tuning_background
from app.tune.plan import Tuning

log = structlog.get_logger()


def serve(asker: Connection) -> None:
    """Compute what is asked for. Raises EOFError or ConnectionError when the asker has gone."""
    work: ComputeRequest = asker.recv()
    with slots.held(work.at_once, lambda: _wait(asker)):
        asker.send(Begun())
        request, workers = work.request, work.workers
        results = (
            tuning_background.results(request, workers)
            if isinstance(request, Tuning)
            else background.results(request, workers)
        )
        for result in results:
            asker.send(result)
    asker.send(SweepDone())


def _wait(asker: Connection) -> None:
    if asker.poll():
        raise EOFError  # it says nothing more, so it has gone
    asker.send(Waiting())


def main() -> None:
    configure_as_parent()
    with Connection(int(sys.argv[1])) as asker:
        try:
            serve(asker)
        except (EOFError, ConnectionError):
            log.debug("nobody waits for the rest")
        except (ScenarioError, OSError) as error:
            reason = str(error) if isinstance(error, ScenarioError) else error.strerror or str(error)
            log.warning("a map or search failed", reason=reason)
            with contextlib.suppress(OSError):
                asker.send(SweepFailed(reason))
        except Exception as error:  # the process's last resort: report it
            log.exception("fault", stage="a map")
            with contextlib.suppress(OSError):
                asker.send(SweepFailed(f"internal error: {type(error).__name__}: {error}"))


if __name__ == "__main__":
    main()
