"""Process that compiles kernels in advance, so that a change of robot or contact need not wait for them.

Kernels are compiled once for each number of joints; they stay in the cache for every later start.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import structlog

from app.process import launcher
from app.process.log import configure_as_parent
from app.process.precompile import mark
from app.scenario.admitted_contacts import admitted_contacts
from app.scenario.data import edited, load
from app.scenario.schema import Scenario
from app.session.changes import in_mode, on_robot
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.warm_up import warm_up, warm_up_for_own_laws
from controllers.modes import MODES
from environments.catalogue import CATALOGUE
from environments.contact_kinds import CONTACTS


def compiled(joints: int | None = None) -> Iterator[ClosedLoop]:
    """Loops that have run a period of each scenario that needs other kernels, as for a page. joints: their number, None
    for all."""
    for scenario in to_compile(joints):
        loop = warm_up(scenario)
        warm_up_for_own_laws(loop.system)
        CompiledRun(loop)
        yield loop


def to_compile(joints: int | None) -> Iterator[Scenario]:
    """Scenarios to compile: one for each number of joints and each kind of contact that needs other kernels. joints:
    their number, None for all."""
    done: set[int] = set()
    for name, entry in CATALOGUE.items():
        if (n := len(entry.rotor_inertia)) not in done and joints in (None, n):
            done.add(n)
            base = on_robot(load("ur5-hybrid"), name)
            for contact in _contacts(base.contact.kind):
                yield _with_contact(base, contact)


def _contacts(first: str) -> Iterable[str]:
    """Kinds of contact that need other kernels, by name, and `first` among them."""
    by_kernels: dict[tuple[bool, ...], str] = {}
    for name in (first, *CONTACTS):
        kind = CONTACTS[name]
        by_kernels.setdefault((kind.springs, kind.massive, kind.rigid), name)
    return by_kernels.values()


def _with_contact(base: Scenario, contact: str) -> Scenario:
    """The scenario with another kind of contact, in its own mode or, where that does not admit it, in the first one
    that does."""
    mode = next(mode for mode in (MODES[base.mode], *MODES.values()) if contact in admitted_contacts(mode))
    return edited(in_mode(base, mode.name), "contact.kind", contact)


def main() -> None:
    """Compile until it is done or the process that began this ends."""
    configure_as_parent()
    launcher.end_with_parent()
    try:
        for _ in compiled():
            pass
        mark().touch()
    except Exception as error:  # nobody waits for it: missing kernels are compiled when they are needed
        structlog.get_logger().warning("compiling ahead failed", exc_info=error)


if __name__ == "__main__":
    main()
