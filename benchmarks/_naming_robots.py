"""The robots of the blind draws: bundled ones, arms of example-robot-data, and URDF files."""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ElementTree
from functools import cache
from pathlib import Path

from bdnn_ros.errors import DataError
from bdnn_ros.robot import BUNDLED, Robot

ROMEO = "ShoulderPitch ShoulderYaw ElbowRoll ElbowYaw WristRoll WristYaw WristPitch"
G1 = "shoulder_pitch shoulder_roll shoulder_yaw elbow wrist_roll wrist_pitch wrist_yaw"
EXAMPLES: dict[str, tuple[str, tuple[str, ...]]] = {
    "romeo": ("romeo_description/urdf/romeo_small.urdf", tuple(f"L{name}" for name in ROMEO.split())),
    "g1": ("g1_description/urdf/g1_29dof_rev_1_0.urdf", tuple(f"left_{name}_joint" for name in G1.split())),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", ()),
    "ur3": ("ur_description/urdf/ur3_robot.urdf", ()),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", ()),
    "panda": ("panda_description/urdf/panda.urdf", tuple(f"panda_joint{k}" for k in range(1, 8))),
    "kinova": ("kinova_description/robots/kinova.urdf", ()),
    "z1": ("z1_description/urdf/z1.urdf", ()),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", ()),
    "so100": ("so_arm_description/urdf/so100.urdf", ()),
}
"""Arms of example-robot-data, files and joints, none for all: nothing in the diagnosis was chosen by them."""
KEPT = ("link", "joint", "inertial", "origin", "parent", "child", "axis", "limit")
"""What tells of links and joints in a URDF."""


@cache
def robot_of(name: str) -> Robot:
    """A bundled robot, one of example-robot-data, or one of a URDF file."""
    if name in BUNDLED:
        return Robot.bundled(name)
    if name in EXAMPLES:
        file, joints = EXAMPLES[name]
        return Robot.from_file(example(file), joints)
    return Robot.from_file(Path(name))


@cache
def bare(name: str) -> Robot:
    """The same robot by a description of its links and joints alone, that another simulator reads, too.

    Joints that are not the arm's are fixed; nothing is said of friction, damping or shapes.
    """
    robot = robot_of(name)
    tree = ElementTree.fromstring(robot.urdf)
    for joint in tree.findall("joint"):
        if joint.get("name") not in robot.joints:
            joint.set("type", "fixed")
    for part in [tree, *tree.findall("link"), *tree.findall("joint")]:
        for child in [child for child in part if child.tag not in KEPT]:
            part.remove(child)
    return Robot.from_urdf(ElementTree.tostring(tree, encoding="unicode"), robot.joints)


def example(file: str) -> Path:
    """A description of example-robot-data.

    Raises:
        DataError: example-robot-data is not installed.
    """
    for folder in map(Path, sys.path):
        path = folder / "cmeel.prefix" / "share" / "example-robot-data" / "robots" / file
        if path.is_file():
            return path
    raise DataError(f"There is no {Path(file).name} here.", 'Install it: pip install ".[bench-extra]".')
