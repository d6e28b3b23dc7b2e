"""Parts of arms in the scene, and their store on disk."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest

from app.dashboard.scene import robot_view
from app.dashboard.scene.arm_parts import parts
from app.dashboard.scene.robot_view import Paint, RobotView
from app.dashboard.view_options import FINE, LIGHT
from app.storage.link_meshes import link_meshes
from app.storage.part_store import ArmPart, PartStore
from environments import robots
from tests.support.viser_insides import scene_stand_in

BENT = Path(__file__).parents[1] / "support" / "robots" / "bent3r.urdf"


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> PartStore:
    monkeypatch.setattr(robot_view, "PartStore", lambda: PartStore(tmp_path))
    return PartStore(tmp_path)


def _shown(robot: robots.Robot, paint: Paint | None = None) -> list[ArmPart]:
    """Parts that a view of the arm adds to its scene."""
    scene = scene_stand_in()
    RobotView(scene, robot, "/arm", FINE, paint)
    return [
        ArmPart(call.args[0].count("/") - 2, call.kwargs["color"], *call.args[1:])
        for call in scene.add_mesh_simple.call_args_list
    ]


def _same(a: list[ArmPart], b: list[ArmPart]) -> bool:
    return len(a) == len(b) and all(
        (one.joint, one.color) == (other.joint, other.color)
        and np.array_equal(one.vertices, other.vertices)
        and np.array_equal(one.faces, other.faces)
        for one, other in zip(a, b, strict=True)
    )


@pytest.mark.usefixtures("store")
def test_the_meshes_of_an_arm_of_ours_are_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, coat = robots.load("ur5"), Paint((1, 2, 3), 0.5, 0.01)
    meshes = link_meshes(robot).result()
    first, coated = _shown(robot), _shown(robot, coat)
    assert _same(first, parts(robot, meshes, FINE))
    assert {part.joint for part in first} == set(range(7))
    reach = max(float(np.abs(part.vertices).max()) for part in first)
    assert 0.3 < reach < 0.7  # the upper arm, m
    for plain, thick in zip(first, coated, strict=True):
        corners = np.unique(plain.faces)
        assert np.median(np.linalg.norm((thick.vertices - plain.vertices)[corners], axis=1)) == pytest.approx(
            0.01, abs=1e-6
        )
    monkeypatch.setattr(robot_view, "link_meshes", MagicMock(side_effect=AssertionError))
    assert _same(_shown(robots.load("ur5")), first)
    assert _same(_shown(robot, coat), coated)


def test_other_arms_tools_and_details_are_other_files(store: PartStore) -> None:
    ur5, planar = robots.load("ur5"), robots.load("planar2r")
    store.write(ur5, FINE, 0.0, [ArmPart(1, (9, 9, 9), np.eye(3, dtype=np.float32), np.array([[0, 1, 2]]))])
    assert store.read(ur5, FINE, 0.0) is not None
    for other in (
        planar,
        robots.load("ur3"),
        replace(ur5, tool_offset=np.full(3, 0.1)),
        replace(ur5, locked={"a": 0.1}),
    ):
        assert store.read(other, FINE, 0.0) is None
    assert store.read(ur5, LIGHT, 0.0) is None
    assert store.read(ur5, FINE, 0.001) is None


@pytest.mark.usefixtures("store")
def test_parts_of_an_arm_of_ones_own_are_not_kept(tmp_path: Path) -> None:
    arm = tmp_path / "arm" / "arm.urdf"
    arm.parent.mkdir()
    arm.write_text(BENT.read_text())
    assert len(_shown(robots.load("", urdf=str(arm)))) > 3
    assert list(tmp_path.glob("*.npz")) == []


@pytest.mark.parametrize(
    "change",
    [
        {"vertices": np.full((3, 3), np.nan)},
        {"vertices": np.zeros((4, 3))},
        {"vertices": np.zeros((3, 2))},
        {"faces": np.array([[0, 1, 3]])},
        {"faces": np.array([[-1, 0, 1]])},
        {"joints": np.array([7])},
        {"joints": np.array([1, 2])},
        {"colors": np.zeros((1, 4))},
        {"counts": np.array([[1, 1]])},
        {"counts": None},
    ],
)
def test_a_file_that_holds_no_parts_counts_as_none(store: PartStore, tmp_path: Path, change: dict) -> None:
    robot = robots.load("ur5")
    store.write(robot, FINE, 0.0, [ArmPart(6, (9, 9, 9), np.eye(3, dtype=np.float32), np.array([[0, 1, 2]]))])
    assert store.read(robot, FINE, 0.0) is not None
    (file,) = tmp_path.iterdir()
    with np.load(file) as known:
        arrays = dict(known) | change
    np.savez(file, **{name: array for name, array in arrays.items() if array is not None})
    assert store.read(robot, FINE, 0.0) is None


def _of_unknown_compression(archive: bytes) -> bytes:
    """The archive with another compression method in its directory, which zipfile does not know."""
    entry = archive.index(b"PK\x01\x02")
    return archive[: entry + 10] + b"\x55\x00" + archive[entry + 12 :]


@pytest.mark.parametrize("content", [None, b" ", b"PK\x03\x04", b"no archive", b"\x93NUMPY"])
def test_a_damaged_file_is_replaced(store: PartStore, tmp_path: Path, content: bytes | None) -> None:
    robot = robots.load("planar2r")
    first = _shown(robot)
    (file,) = tmp_path.iterdir()
    file.write_bytes(content or _of_unknown_compression(file.read_bytes()))
    assert store.read(robot, FINE, 0.0) is None
    assert _same(_shown(robot), first)
    assert store.read(robot, FINE, 0.0) is not None


def test_old_files_make_room(tmp_path: Path) -> None:
    robot, store = robots.load("planar2r"), PartStore(tmp_path, kept=4)
    part = ArmPart(1, (9, 9, 9), np.eye(3, dtype=np.float32), np.array([[0, 1, 2]]))
    for number in range(9):
        store.write(robot, FINE, float(number), [part])
        assert store.read(robot, FINE, float(number)) is not None
        assert len(list(tmp_path.iterdir())) <= 4


def test_nothing_is_kept_where_nothing_can_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    robot, store = robots.load("planar2r"), PartStore(tmp_path / "file")
    store.write(robot, FINE, 0.0, [ArmPart(1, (9, 9, 9), np.eye(3, dtype=np.float32), np.array([[0, 1, 2]]))])
    assert store.read(robot, FINE, 0.0) is None
