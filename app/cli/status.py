"""Exit statuses of the commands."""

DONE = 0
FAULT = 1  # a fault of this program, or output that cannot be written
BAD_INPUT = 2
STOPPED = 3  # a simulation stopped before its end
BROKEN = 4  # `run --strict`: the theorem's promise was broken
UNPROMISED = 5  # `run --strict`: nothing was promised
