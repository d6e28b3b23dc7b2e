"""Arms with prismatic joints: their coordinates, the run, and the units that are shown and stored of them."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from app.analysis.glossary import GLOSSARY
from app.analysis.metrics import account, angle_error, path_error
from app.dashboard.plots.charts import Setup
from app.dashboard.plots.law_drawings import robust_terms, terms_of_torque, torques
from app.dashboard.plots.task_drawings import one_coordinate, position_error, rotation_error, tracking_error
from app.scenario.data import edited, load
from app.scenario.schema import Scenario
from app.session.snapshot import snapshot_of
from app.simulation.closed_loop import ClosedLoop
from app.storage.joint_kinds import units_of
from app.storage.recording_files import csv_header, table, write_npz
from app.tune.plan import known_aims
from environments import robots

RAIL = str(Path(__file__).parents[1] / "support" / "robots" / "rail2r.urdf")
POSTURE = (-0.1, -0.6, 1.3)  # m, rad, rad


def on_rail(**fields: object) -> Scenario:
    """The arm on a rail in motion mode. fields: values by dotted path, with "__" for the dot."""
    scenario = load("planar3r-hybrid")
    still = {"robot__urdf": RAIL, "robot__posture": POSTURE, "mode": "motion", "motion": {"kind": "hold"}}
    given = still | {"simulation__duration": 1.0} | fields
    for path, value in given.items():
        scenario = edited(scenario, path.replace("__", "."), value)
    return scenario


def ran(scenario: Scenario, periods: int) -> ClosedLoop:
    loop = ClosedLoop.from_scenario(scenario)
    for _ in range(periods):
        loop.step()
    assert loop.stopped is None, loop.stopped
    return loop


@pytest.fixture(scope="module")
def supplemental() -> ClosedLoop:
    """The rail as supplemental coordinate, which moves by 5 cm while the tool stays."""
    path = {"kind": "point-to-point", "displacement": [0.05], "duration": 0.3}
    return ran(on_rail(task_space__supplemental=[1], rotation=path), 500)


@pytest.fixture(scope="module")
def in_joints() -> ClosedLoop:
    return ran(on_rail(task_space__kind="joint"), 20)


def test_an_arm_that_slides_in_its_plane_is_planar() -> None:
    robot = robots.load("", urdf=RAIL)
    assert (robot.geometry, robot.slides) == ("planar", (True, False, False))
    assert not any(robots.load("planar3r").slides)


def test_a_prismatic_supplemental_joint_counts_in_metres(supplemental: ClosedLoop) -> None:
    system, rows = supplemental.system, supplemental.recording.stretch()
    assert [(c.name, c.unit, c.is_angle) for c in system.coordinates][-1] == ("q₁", "m", False)
    np.testing.assert_array_equal(rows["r"][:, 2], rows["q"][:, 0])
    assert system.observe(system.q_0, np.zeros(3), 0.0)[1].J_q[2].tolist() == [1.0, 0.0, 0.0]
    assert rows["q"][-1, 0] - rows["q"][0, 0] == pytest.approx(0.05, abs=1e-4)
    np.testing.assert_allclose(rows["tool"][-1], rows["tool"][0], atol=1e-4)
    assert angle_error(system, rows) is None
    path = path_error(system, rows)
    assert path is not None
    np.testing.assert_allclose(path, np.linalg.norm(rows["e_r"], axis=1))


def test_a_file_has_the_unit_of_each_joint(in_joints: ClosedLoop, supplemental: ClosedLoop) -> None:
    heads = csv_header(table(in_joints.system.scenario, in_joints.recording))
    for column in ("q[0] [m]", "q[1] [rad]", "q_dot[0] [m/s]", "tau[0] [N]", "tau[2] [N·m]", "e_r[0] [m]",
                   "e_r[2] [rad]", "s[0] [m/s]", "d [N·m and N]", "s_norm [rad/s and m/s]"):  # fmt: skip
        assert column in heads
    heads = csv_header(table(supplemental.system.scenario, supplemental.recording))
    assert {"tau_gravity[0] [N]", "q_eq_ddot[1] [rad/s^2]", "e_r[2] [m]", "d [N]", "sigma_min [m and 1]"} <= set(heads)
    archive = io.BytesIO()
    write_npz(table(in_joints.system.scenario, in_joints.recording), archive)
    archive.seek(0)
    units = dict(line.split(": ") for line in np.load(archive)["units"].tolist())
    assert (units["q"], units["tau"], units["F"]) == ("m, rad, rad", "N, N·m, N·m", "N")


def test_plots_and_metrics_say_which_units_they_show(in_joints: ClosedLoop) -> None:
    snapshot = snapshot_of(in_joints)
    rail, elbow = (Setup.of(snapshot, joint, joint) for joint in (0, 2))
    assert torques(rail).title == "joint torques and forces  τ  [N·m and N]"
    assert [terms_of_torque(each).title.rpartition("  ")[2] for each in (rail, elbow)] == ["[N]", "[N·m]"]
    assert [getattr(robust_terms(each), "title", "")[-5:] for each in (rail, elbow)] == ["  [N]", "[N·m]"]
    assert [one_coordinate(each).title[-6:] for each in (rail, elbow)] == ["  [mm]", "[mrad]"]
    assert tracking_error(rail).title.endswith("[mrad and mm]")
    drawings = position_error(rail), rotation_error(rail)
    assert [each and (each.title[-6:], len(each.lines)) for each in drawings] == [("  [mm]", 1), ("[mrad]", 2)]
    assert in_joints.system.units.of_model["K_m"] == "N·m/rad and N/m"
    symbols = {symbol.written: symbol for symbol in GLOSSARY}
    row = in_joints.recording.at(in_joints.t)
    force, torque, _ = symbols["τ"].value(row, in_joints.system, {}).split(", ")
    assert (force.split()[1], torque.split()[1]) == ("N", "N·m")
    assert symbols["d"].value(row, in_joints.system, {}).endswith(" N·m and N")
    assert account(in_joints.system, in_joints.recording, 0.0, in_joints.t) is not None


def test_units_of_a_scenario_are_those_of_its_arm(in_joints: ClosedLoop, tmp_path: Path) -> None:
    scenario = in_joints.system.scenario
    assert units_of(scenario) == in_joints.system.units
    assert units_of(load("ur5-motion")) == ("cartesian", "revolute")
    gone = edited(scenario, "robot.urdf", str(tmp_path / "gone.urdf"))
    assert units_of(gone) == ("joint", "revolute")


@pytest.mark.parametrize(("joint", "turns"), [(1, False), (3, True)])
def test_a_tuning_knows_an_error_of_angles_only_where_a_joint_beside_the_tool_turns(joint: int, turns: bool) -> None:
    loop = ran(on_rail(task_space__supplemental=[joint]), 1)
    found = angle_error(loop.system, loop.recording.signals(("e_r",)))
    assert (found is not None) == ("angle_error" in known_aims(loop.system.scenario)) == turns
