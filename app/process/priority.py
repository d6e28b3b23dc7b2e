"""Priority of threads: lower for computations beside the running loop, real time for the loop."""

from __future__ import annotations

import os

from app.process.cores import usable_cores

# Environment variable that keeps all at one priority: without an idle core what has stepped back gets no turn.
SAME = "VSMRC_SAME_PRIORITY"


def lower_priority(niceness: int) -> None:
    """Lower the priority of the calling thread (on Linux; elsewhere of its process), and of what it starts, so that the
    loop comes first. niceness: by how much, up to 19."""
    if os.environ.get(SAME) != "1":
        os.nice(niceness)


class RealTimePriority:
    """Real-time priority of the thread that uses it: it runs before all threads of usual priority, as control loops of
    robots do. Linux allows it to root and to users with a limit `rtprio` (`ulimit -r`). Where it is not allowed, and
    with a single core, of which nothing would be left for the others, the priority stays as it is.

    held: whether the thread has it now.
    """

    def __init__(self) -> None:
        self.held = False
        self._available = hasattr(os, "sched_setscheduler") and usable_cores() > 1

    def hold(self) -> None:
        """Take real-time priority. What the thread starts has the usual one."""
        if self._available and not self.held:
            try:
                os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(1))
            except OSError:  # not allowed, also by what locks the system calls of a container
                self._available = False
            else:
                self.held = True

    def give_back(self) -> None:
        """Go back to the usual priority."""
        if self.held:
            os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
            self.held = False
