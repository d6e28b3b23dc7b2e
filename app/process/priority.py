"""Priority of computations beside the running loop."""

import os

# Environment variable that keeps all at one priority: without an idle core what has stepped back gets no turn.
SAME = "VSMRC_SAME_PRIORITY"


def lower_priority(niceness: int) -> None:
    """Lower the priority of the calling thread (on Linux; elsewhere of its process), and of what it starts, so that the
    loop comes first. niceness: by how much, up to 19."""
    if os.environ.get(SAME) != "1":
        os.nice(niceness)
