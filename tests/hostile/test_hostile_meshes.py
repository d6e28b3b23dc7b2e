"""Meshes that try to take the machine, and the process that reads them."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import zipfile
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest

from app.dashboard.scene.robot_view import RobotView
from app.storage import link_meshes
from drivers.visitors import gone
from environments import robots
from tests.support.urdf_texts import BENT, UPPER, entities
from tests.support.viser_insides import scene_stand_in

pytestmark = pytest.mark.slow  # processes of its own


def _bomb(path: Path) -> None:
    packed = zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1)
    with packed as archive, archive.open("a.dae", "w", force_zip64=True) as entry:
        for _ in range(16):
            entry.write(bytes(100_000_000))


def _pipe(path: Path) -> None:
    os.mkfifo(path.with_name("pipe.png"))
    path.with_name("a.mtl").write_text("newmtl m\nmap_Kd pipe.png\n")
    path.write_text("mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")


def _lie(path: Path) -> None:
    path.write_bytes(bytes(80) + struct.pack("<I", 4_000_000_000) + bytes(500))


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("bomb.dae", _bomb),  # an archive that becomes 1.6 GB
        ("pipe.obj", _pipe),  # a picture that never comes
        ("lie.stl", _lie),  # a header that claims 4e9 triangles
        ("laughs.dae", lambda path: path.write_text(entities(9).replace("robot", "COLLADA"))),
    ],
)
def test_meshes_that_would_take_the_machine_are_not_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, make
) -> None:
    monkeypatch.setattr(link_meshes, "PATIENCE", 3.0 if name == "pipe.obj" else 60.0)
    make(tmp_path / name)
    arm = tmp_path / "arm.urdf"
    mesh = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
    arm.write_text(BENT.replace(UPPER, UPPER + mesh))
    assert link_meshes.link_meshes(robots.load("", urdf=str(arm))).result(200.0) == ()


def test_the_process_that_reads_meshes_ends_with_the_one_that_began_it(tmp_path: Path) -> None:
    _pipe(tmp_path / "pipe.obj")
    arm = tmp_path / "arm.urdf"
    arm.write_text(BENT.replace(UPPER, UPPER + '<visual><geometry><mesh filename="pipe.obj"/></geometry></visual>'))
    code = f"""
import os, pathlib, time
from app.storage import link_meshes
from environments import robots
link_meshes.link_meshes(robots.load("", urdf={str(arm)!r}))
children = pathlib.Path(f"/proc/{{os.getpid()}}/task")
while not (found := "".join(path.read_text() for path in children.glob("*/children")).split()):
    time.sleep(0.05)
print(*found, flush=True)
time.sleep(1.0)
os._exit(0)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600, check=True)
    (reader,) = map(int, done.stdout.split())
    assert gone(reader)


def test_a_mesh_of_ones_own_is_shown(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    arm = tmp_path / "arm.urdf"
    visual = '<visual><origin xyz="0 0 2"/><geometry><mesh filename="a.obj"/></geometry></visual>'
    arm.write_text(BENT.replace(UPPER, UPPER + visual))
    robot, scene = robots.load("", urdf=str(arm)), scene_stand_in()
    scene.add_mesh_simple.side_effect = lambda name, *_, **__: MagicMock(path=name)
    view = RobotView(scene, robot, "/arm")
    bones = list(view._shapes)
    assert {Path(bone.path).name[:5] for bone in bones} == {"bone_"}  # nobody waits for the process that reads
    (mesh,) = link_meshes.link_meshes(robot).result(200.0)
    assert mesh.link == "upper"
    np.testing.assert_allclose(mesh.vertices.max(axis=0), [1, 1, 2])
    for _ in range(2):
        view.show(np.zeros(robot.n))
        assert all(bone.remove.call_count == 1 for bone in bones)
        assert {Path(shape.path).name[:5] for shape in view._shapes} == {"mesh_"}
