"""The joints that the node is told to use."""

from __future__ import annotations

from collections.abc import Sequence

from bdnn_ros.errors import UsageError, listed
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mimics import with_mimics


def with_joints(robot: Robot, joints: Sequence[str]) -> Robot:
    """The robot with these joints only, in this order; all but those that mimic another where none is named.

    Raises:
        UsageError: it has no such joint.
    """
    movable = with_mimics(robot)
    unknown = [joint for joint in joints if joint not in movable]
    if unknown:
        raise UsageError(
            f"The robot description has no movable joint {listed(unknown)}; it has {listed(robot.joints, 20)}.",
            "Correct the parameter joints.",
        )
    return Robot.from_urdf(robot.urdf, joints) if joints else robot
