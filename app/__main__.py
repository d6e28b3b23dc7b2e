"""The `vsmrc` command."""

from __future__ import annotations

import sys

from app.process.deadline import end

INTERRUPTED = 130


def main() -> None:
    """Entry point: exit status 0 done, 1 a fault of the program, 2 bad input, 3 the simulation stopped, 130 Ctrl-C;
    `serve` ends with 0 on Ctrl-C, SIGTERM and SIGHUP."""
    status = INTERRUPTED
    try:
        # here: it takes a second, in which Ctrl-C must not end in a traceback
        if sys.argv[1:] == ["--version"]:
            from app.cli.version import execute
        else:
            from app.cli.commands import execute
        from app.cli.output import CommandOutput

        output = CommandOutput()
        try:
            done = execute(sys.argv[1:])
        except SystemExit as ended:  # of tyro, after --help
            done = int(ended.code or 0)
        status = output.status(done)
    except KeyboardInterrupt:
        pass
    end(status)  # no sooner: the interruption holds what was under way, such as a pool of processes


if __name__ == "__main__":
    main()
