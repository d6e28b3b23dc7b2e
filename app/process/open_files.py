"""Limit of open files of a process: a limit that is too low is reported at the start, not to visitors later."""

from __future__ import annotations

import resource

from app.scenario.errors import ScenarioError


def require(files: int, reason: str) -> None:
    """Raise the limit of open files to `files`. Raises ScenarioError where this process may not. reason: for its
    sentence."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= files:
        return
    if hard != resource.RLIM_INFINITY and hard < files:
        raise ScenarioError(f"open files: {hard} (ulimit -n); allowed: {files} or more, {reason}")
    resource.setrlimit(resource.RLIMIT_NOFILE, (files, hard))
