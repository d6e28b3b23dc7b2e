"""Command `vsmrc list`: shows the robots and the scenarios."""

from __future__ import annotations

from app.cli.status import DONE
from app.scenario.data import shipped


def list_() -> int:
    """List the robots and the shipped scenarios."""
    from environments.robots import CATALOGUE

    print("robots")
    for name, entry in CATALOGUE.items():
        print(f"  {name:34s} {entry.title}")
    print("scenarios")
    for name, scenario in shipped().items():
        print(f"  {name:34s} {scenario.title}")
    return DONE
