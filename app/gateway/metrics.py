"""Metrics endpoint of a gateway, for its operator, in the text format of Prometheus:
https://prometheus.io/docs/instrumenting/."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple, get_args

from app.gateway.session import Phase
from app.gateway.session_pool import SessionPool

TYPE = "text/plain; version=0.0.4"


class _Family(NamedTuple):
    """Metric family: values of one name, each with its labels."""

    name: str
    kind: str
    help: str
    values: Iterable[tuple[str, float]]


def metrics(pool: SessionPool, refusals: Counter[str]) -> str:
    """Text of the metrics endpoint. refusals: their number by reason; the reasons are words of this program, never of a
    visitor."""
    sessions = pool.sessions
    phases = Counter(session.phase for session in sessions)
    pages = Counter(page.kind for session in sessions for page in session.pages)
    late = [process.late for session in sessions if (process := session.process) and process.late is not None]
    families = [
        _Family("sessions", "gauge", "Sessions by phase.", [(f'phase="{p}"', phases[p]) for p in get_args(Phase)]),
        _Family("places", "gauge", "Sessions that may run at once.", [("", pool.capacity)]),
        _Family("pages", "gauge", "Open pages.", [(f'kind="{kind}"', pages[kind]) for kind in ("steer", "watch")]),
        _Family("crashes_total", "counter", "Processes of sessions that ended or hung.", [("", pool.crashes)]),
        _Family(
            "lateness_seconds",
            "gauge",
            "Median lateness of the control steps of the session whose is largest.",
            [("", max(late, default=0.0))],
        ),
        _Family(
            "refusals_total",
            "counter",
            "Requests and pages refused.",
            [(f'reason="{reason}"', count) for reason, count in sorted(refusals.items())],
        ),
    ]
    return "".join(_written(family) for family in families)


def _written(family: _Family) -> str:
    name = f"vsmrc_{family.name}"
    lines = [f"# HELP {name} {family.help}", f"# TYPE {name} {family.kind}"]
    lines += [
        f"{name}{{{labels}}} {value:.12g}" if labels else f"{name} {value:.12g}" for labels, value in family.values
    ]
    return "\n".join(lines) + "\n"
