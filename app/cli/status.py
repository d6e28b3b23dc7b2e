"""Exit statuses of the commands."""

DONE = 0
FAULT = 1  # of ours
BAD_INPUT = 2
STOPPED = 3  # a simulation before its end
BROKEN = 4  # `run --strict`: the theorem's promise
UNPROMISED = 5  # `run --strict`: nothing was promised
