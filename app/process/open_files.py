"""Limit of open files of a process: a limit that is too low is reported at the start, not to visitors later."""

from __future__ import annotations

import resource

from app.scenario.schema import ScenarioError


def require(files: int, reason: str) -> None:
    """Raise the limit to so many files, as far as this process may. Raises ScenarioError where it may not."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= files:
        return
    if hard != resource.RLIM_INFINITY and hard < files:
        raise ScenarioError(f"open files: {hard} (ulimit -n); allowed: {files} or more, {reason}")
    resource.setrlimit(resource.RLIMIT_NOFILE, (files, hard))
