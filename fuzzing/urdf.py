"""Fuzzing of uploaded URDFs: Pinocchio must be able to read every admitted one, and either an arm is built or it is
refused."""

import tempfile
from contextlib import suppress
from pathlib import Path

from environments import urdf
from environments.robots import load
from environments.urdf import RobotError

SEEDS = tuple(
    (Path(__file__).parents[1] / path).read_bytes()
    for path in ("static/robots/planar2r.urdf", "static/robots/planar3r.urdf", "tests/support/robots/bent3r.urdf")
)
DICTIONARY = (
    *('<joint name="', 'type="continuous"', 'type="prismatic"', 'type="fixed"', "<mimic ", "<limit ", "<inertia "),
    *('nan"', '"1e-320"', '"-1"', '"1e6"', "<origin rpy=", "<geometry>", "<visual>", "</link>"),
    *("<mesh filename=", "package://", "../", "<!DOCTYPE", "&a;"),
)
_FILE = Path(tempfile.mkdtemp(prefix="vsmrc-fuzz-")) / "arm.urdf"


def read(data: bytes) -> None:
    with suppress(RobotError):
        urdf.parse(data, "arm.urdf")
        _FILE.write_bytes(data)
        load("", urdf=str(_FILE))
