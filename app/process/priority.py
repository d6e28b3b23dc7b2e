"""Priority of computations beside the running loop."""

import os

# Environment variable that keeps all at one priority: without an idle core what has stepped back gets no turn.
SAME = "VSMRC_SAME_PRIORITY"


def step_back(niceness: int) -> None:
    """Lower the priority of the calling thread, and of what it starts, so that the loop comes first. niceness: by how
    much, up to 19."""
    if not os.environ.get(SAME):
        os.nice(niceness)
