"""The `vsmrc` command."""

from __future__ import annotations

import sys

INTERRUPTED = 130


def main() -> None:
    """Entry point: exit status 0 done, 1 a fault of the program, 2 bad input, 3 the simulation stopped, 130 Ctrl-C;
    `serve` ends with 0 on Ctrl-C, SIGTERM and SIGHUP."""
    try:
        # here: it takes a second, in which Ctrl-C must not end in a traceback
        from app.cli.commands import execute
        from app.process.deadline import end

        end(execute(sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
