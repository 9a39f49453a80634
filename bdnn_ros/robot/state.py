"""A robot as arrays and JSON-able data: part of every model file."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from bdnn_ros.robot import Robot

ARRAYS = ("inertials", "armature", "viscous", "coulomb", "zeros", "gravity_vector")


def robot_state(robot: Robot) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Arrays and JSON-able data from which `robot_from_state` restores the robot."""
    arrays = {name: np.asarray(getattr(robot, name), float) for name in ARRAYS}
    return arrays, {"urdf": robot.urdf, "joints": list(robot.joints), "held": dict(robot.held)}


def robot_from_state(arrays: dict[str, np.ndarray], info: dict[str, Any]) -> Robot:
    """The robot of `robot_state`.

    Raises:
        KeyError: an array or an entry is missing.
        RobotError: the description is not usable.
    """
    none = np.zeros(len(info["joints"]))  # files of before have no zeros
    held = {str(joint): float(position) for joint, position in info.get("held", {}).items()}
    robot = Robot.from_urdf(str(info["urdf"]), [str(joint) for joint in info["joints"]], held)
    robot = robot.with_inertials(arrays["inertials"])
    robot = robot.with_joint_parameters(arrays["armature"], arrays["viscous"], arrays["coulomb"])
    return replace(robot, zeros=arrays.get("zeros", none), gravity_vector=arrays["gravity_vector"])
