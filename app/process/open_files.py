"""Open files that a process may have: what is missing is said at the start, not to visitors in the middle of a talk."""

from __future__ import annotations

import resource

from app.scenario.schema import ScenarioError


def require(files: int, reason: str) -> None:
    """Have so many allowed from now on, as far as this process may ask for that. Raises ScenarioError."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= files:
        return
    if hard != resource.RLIM_INFINITY and hard < files:
        raise ScenarioError(f"open files: {hard} (ulimit -n); allowed: {files} or more, {reason}")
    resource.setrlimit(resource.RLIMIT_NOFILE, (files, hard))
