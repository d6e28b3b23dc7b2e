"""Meshes of an arm's links, for showing the arm.

Readers of meshes unpack archives, expand entities and open whatever a file names. Meshes that come with the program are
read in this process; those of any other URDF in a process of its own, `app.workers.link_meshes`, whose time and memory
are limited, and nothing waits for that process.
"""

from __future__ import annotations

import subprocess
import threading
from concurrent.futures import Future
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing import Pipe
from pathlib import Path

import numpy as np
import structlog

from app.process import launcher
from environments import urdf
from environments.robots import Robot

log = structlog.get_logger()

PATIENCE = 20.0  # s that the process may take
CPU = 15  # s of them at work
MEMORY = 2_000_000_000  # bytes of address space, of which Python and its libraries take a quarter
MOST_TRIANGLES = 2_000_000

Rgb = tuple[int, int, int]

_READING = threading.Lock()  # one process at a time, each with all that memory


@dataclass(frozen=True)
class LinkMesh:
    """Mesh of one shape of a link: vertices (N, 3) m in the link's frame, faces (M, 3); color None where the file has
    none."""

    link: str
    color: Rgb | None
    vertices: np.ndarray
    faces: np.ndarray


Meshes = Future[tuple[LinkMesh, ...]]


def link_meshes(robot: Robot) -> Meshes:
    """Meshes of every visual of the arm's URDF that can be shown, now or later; none where they cannot be read, which
    is logged."""
    here: Meshes = Future()
    try:
        changed = robot.urdf.stat().st_mtime_ns
        if not robot.shipped and next(urdf.read(robot.urdf).iter("mesh"), None) is not None:
            return _read_apart(robot.urdf, changed)
        here.set_result(_read_here(robot.urdf, changed))
    except Exception as error:  # whatever readers of meshes raise: the arm can be shown without meshes
        log.warning("visuals not shown", urdf=str(robot.urdf), reason=str(error))
        here.set_result(())
    return here


# the arm, its ghost and pinned runs of it look alike
@lru_cache(maxsize=4)
def _read_here(path: Path, changed: int) -> tuple[LinkMesh, ...]:
    """Meshes of a URDF, read in this process; a file that has not changed is read only once. Raises whatever their
    readers raise."""
    from app.storage.mesh_reading import read  # its libraries take 0.4 s and 50 MB

    del changed
    return tuple(read(path))


@lru_cache(maxsize=4)
def _read_apart(path: Path, changed: int) -> Meshes:
    """Meshes of a URDF, read in a process of its own; a file that has not changed is read only once, also where that
    failed."""
    del changed
    meshes: Meshes = Future()

    def wait() -> None:
        try:
            with _READING:
                meshes.set_result(_answer(path))
        except Exception as error:  # whatever such files lead to: nothing may wait for ever
            reason = str(error) or "reading them took too much memory or time"
            log.warning("visuals not shown", urdf=str(path), reason=reason)
            meshes.set_result(())

    threading.Thread(target=wait, name="visuals", daemon=True).start()
    return meshes


def _answer(path: Path) -> tuple[LinkMesh, ...]:
    ours, theirs = Pipe(duplex=False)
    with ours:
        with theirs:
            process = launcher.start(
                "app.workers.link_meshes",
                str(theirs.fileno()),
                str(path),
                niceness=10,
                stdin=subprocess.PIPE,
                pass_fds=(theirs.fileno(),),
            )
        try:
            if not ours.poll(PATIENCE):
                raise RuntimeError(f"reading them takes more than {PATIENCE:g} s")
            answer: tuple[LinkMesh, ...] | str = ours.recv()
        finally:
            process.kill()
            process.wait()
    if isinstance(answer, str):
        raise RuntimeError(answer)
    return answer
