"""Catalogue of arms: each is a row of `CATALOGUE`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RobotEntry:
    """One row of the catalogue. Angles in rad, inertias in kg m^2, lengths in m."""

    title: str
    urdf: str  # below the URDF root: "static:" or example-robot-data's folder
    tool_frame: str
    posture: dict[str, float]  # joint name -> working posture, away from singularities and joint limits
    rotor_inertia: tuple[float, ...]  # reflected, per joint of the chain
    rotor_source: str
    supplemental: tuple[str, ...] = ()  # joints whose angles complete a square task space (Remark 5)
    tool_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


_UR_POSTURE = {
    "shoulder_pan_joint": 0.0,
    "shoulder_lift_joint": -1.2,
    "elbow_joint": 1.8,
    "wrist_1_joint": -2.1708,
    "wrist_2_joint": -1.5708,
    "wrist_3_joint": 0.0,
}
_PANDA_POSTURE = {
    "panda_joint1": 0.0,
    "panda_joint2": -0.4,
    "panda_joint3": 0.0,
    "panda_joint4": -2.2,
    "panda_joint5": 0.0,
    "panda_joint6": 1.8,
    "panda_joint7": 0.7854,
}
_XARM7_POSTURE = {
    "joint1": 0.0,
    "joint2": -0.3,
    "joint3": 0.0,
    "joint4": 1.0,
    "joint5": 0.0,
    "joint6": 1.3,
    "joint7": 0.0,
}
_Z1_POSTURE = {
    "joint1": 0.0,
    "joint2": 1.8,
    "joint3": -1.3,
    "joint4": 1.0708,
    "joint5": 0.0,
    "joint6": 0.0,
}

CATALOGUE: dict[str, RobotEntry] = {
    "ur5": RobotEntry(
        title="Universal Robots UR5",
        urdf="ur_description/urdf/ur5_robot.urdf",
        tool_frame="tool0",
        posture=_UR_POSTURE,
        rotor_inertia=(1.0, 1.0, 1.0, 0.1, 0.1, 0.1),
        rotor_source="assumed",
    ),
    "ur3": RobotEntry(
        title="Universal Robots UR3",
        urdf="ur_description/urdf/ur3_robot.urdf",
        tool_frame="tool0",
        posture=_UR_POSTURE,
        rotor_inertia=(0.4, 0.4, 0.4, 0.05, 0.05, 0.05),
        rotor_source="assumed",
    ),
    "ur10": RobotEntry(
        title="Universal Robots UR10",
        urdf="ur_description/urdf/ur10_robot.urdf",
        tool_frame="tool0",
        posture=_UR_POSTURE,
        rotor_inertia=(2.0, 2.0, 2.0, 0.2, 0.2, 0.2),
        rotor_source="assumed",
    ),
    "panda": RobotEntry(
        title="Franka Emika Panda",
        urdf="panda_description/urdf/panda.urdf",
        tool_frame="panda_hand_tcp",
        posture=_PANDA_POSTURE,
        rotor_inertia=(0.6, 0.6, 0.5, 0.5, 0.2, 0.2, 0.2),
        rotor_source="assumed",
        supplemental=("panda_joint3",),
    ),
    "xarm7": RobotEntry(
        title="UFACTORY xArm7",
        urdf="xarm_description/urdf/xarm7.urdf",
        tool_frame="link_eef",
        posture=_XARM7_POSTURE,
        rotor_inertia=(0.1,) * 7,
        rotor_source="MuJoCo Menagerie, ufactory_xarm7/xarm7.xml",
        supplemental=("joint3",),
    ),
    "z1": RobotEntry(
        title="Unitree Z1 with gripper",
        urdf="z1_description/urdf/z1.urdf",
        tool_frame="gripperStator",
        posture=_Z1_POSTURE,
        rotor_inertia=(0.2, 0.2, 0.2, 0.05, 0.05, 0.05),
        rotor_source="assumed",
        tool_offset=(0.149, 0.0, 0.0),  # between the jaws' tips
    ),
    "planar2r": RobotEntry(
        title="Planar 2R (vertical plane)",
        urdf="static:planar2r.urdf",
        tool_frame="tool",
        posture={"joint1": 1.2, "joint2": -1.7},
        rotor_inertia=(0.05, 0.05),
        rotor_source="assumed",
    ),
    "planar3r": RobotEntry(
        title="Planar 3R (vertical plane)",
        urdf="static:planar3r.urdf",
        tool_frame="tool",
        posture={"joint1": 1.2, "joint2": -1.5, "joint3": -1.0},
        rotor_inertia=(0.05, 0.05, 0.02),
        rotor_source="assumed",
    ),
}
