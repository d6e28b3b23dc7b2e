"""Reading of the meshes that a URDF names, by trimesh and yourdfpy."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

import numpy as np
import trimesh
import yourdfpy

from app.storage.link_meshes import LinkMesh, Rgb
from environments import urdf

_BRIGHTEN = 0.55


def read(path: Path) -> Iterator[LinkMesh]:
    """Meshes of a URDF, read in this process. Raises whatever their readers raise."""
    root = urdf.read(path)
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            shapes = [found for tag in urdf.SHAPES for found in visual.findall(f"geometry/{tag}")]
            missing = [m for m in shapes if m.tag == "mesh" and urdf.mesh_file(path, m.get("filename", "")) is None]
            if missing or not shapes:
                link.remove(visual)
    drawn = yourdfpy.URDF.load(
        BytesIO(ElementTree.tostring(root, encoding="utf-8")),
        filename_handler=lambda fname: str(urdf.mesh_file(path, fname) or ""),
    )
    if drawn.scene is None:
        return
    graph = drawn.scene.graph
    for name, mesh in drawn.scene.geometry.items():
        if isinstance(mesh, trimesh.Trimesh):
            link = graph.transforms.parents[name]
            placed = mesh.copy().apply_transform(graph.get(name, link)[0])
            yield LinkMesh(link, _color(mesh), np.asarray(placed.vertices), np.asarray(placed.faces))


def _color(mesh: trimesh.Trimesh) -> Rgb | None:
    colored = getattr(mesh.visual, "material", mesh.visual)
    rgba = np.asarray(getattr(colored, "main_color", None))
    if rgba.shape != (4,):
        return None
    # Many files hold linear colours, which look almost black; pure white loses its shape in plain lights.
    r, g, b = np.clip(255 * (rgba[:3] / 255) ** _BRIGHTEN, 0, 235)
    return int(r), int(g), int(b)
