"""Other users of this machine: they can reach 127.0.0.1 as well as the user can."""

from __future__ import annotations

import contextlib
import os
import pwd
from pathlib import Path

PEOPLE = range(1000, 60_000)  # uids of people, as Linux systems give them
_NO_SHELLS = ("nologin", "false", "sync")  # an empty field means /bin/sh


def other_people() -> list[str]:
    """Accounts of other people: those in the password database that can log in, and those with running processes (where
    accounts come over the network, the database does not name them)."""
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
