"""Who else may be on this machine: for them 127.0.0.1 is as near as for the user."""

from __future__ import annotations

import contextlib
import os
import pwd
from pathlib import Path

PEOPLE = range(1000, 60_000)  # uids of people, as Linux systems give them
_NO_SHELLS = ("nologin", "false", "sync", "")


def other_people() -> list[str]:
    """Accounts of other people that can log in, as far as the password database names them, and who has processes now
    (where accounts come over the network, it does not)."""
    own = os.getuid()
    accounts = {
        entry.pw_uid: entry.pw_name
        for entry in pwd.getpwall()
        if entry.pw_uid in PEOPLE and entry.pw_shell.rpartition("/")[2] not in _NO_SHELLS
    }
    running = set[int]()
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # it has ended
            running.add(process.stat().st_uid)
    named = accounts | {uid: f"uid {uid}" for uid in running if uid in PEOPLE and uid not in accounts}
    return sorted(name for uid, name in named.items() if uid != own)
