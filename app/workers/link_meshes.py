"""Process that reads the meshes of one URDF: `python -m app.workers.link_meshes FD PATH`.

Started by `app.storage.link_meshes`.
"""

from __future__ import annotations

import logging
import resource
import sys
from multiprocessing.connection import Connection
from pathlib import Path

from app.process import launcher
from app.storage.link_meshes import CPU, MEMORY, MOST_TRIANGLES, LinkMesh
from app.storage.mesh_reading import read


def answer(path: Path) -> tuple[LinkMesh, ...] | str:
    """Meshes of a URDF, or a sentence on the reason where they cannot be read."""
    meshes: list[LinkMesh] = []
    triangles = 0
    try:
        for mesh in read(path):
            meshes.append(mesh)
            triangles += len(mesh.faces)
            if triangles > MOST_TRIANGLES:
                return f"more than {MOST_TRIANGLES} triangles; allowed: fewer"
    except MemoryError:
        return f"reading them takes more than {MEMORY / 1e9:g} GB"
    except Exception as error:  # whatever readers of meshes raise
        return f"{type(error).__name__}: {error}"[:500]
    return tuple(meshes)


def main() -> None:
    logging.basicConfig(level=logging.ERROR)
    launcher.end_with_parent()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (CPU, CPU))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with Connection(int(sys.argv[1])) as asker:
        asker.send(answer(Path(sys.argv[2])))


if __name__ == "__main__":
    main()
