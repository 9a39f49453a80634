"""The joints that the node uses: those that it is told to, else all but one drive's two."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bdnn_ros.errors import UsageError, listed
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mimics import mimicking, with_mimics
from bdnn_ros.robot.urdf import refuse_free


def with_joints(robot: Robot, joints: Sequence[str]) -> Robot:
    """The robot with these joints only, in this order; where none is named all but `leading` and those that mimic another.

    Raises:
        RobotError: none is named, and one has more than one degree of freedom.
        UsageError: it has no such joint.
    """
    if not joints:
        refuse_free(robot.urdf)
    movable = with_mimics(robot)
    unknown = [joint for joint in joints if joint not in movable]
    if unknown:
        raise UsageError(
            f"The robot description has no movable joint {listed(unknown)}; it has {listed(robot.joints, 20)}.",
            "Correct the parameter joints.",
        )
    led = leading(robot)
    used = joints or [joint for joint in robot.joints if joint not in led]
    return robot if tuple(used) == robot.joints else Robot.from_urdf(robot.urdf, used)


def leading(robot: Robot) -> dict[str, str]:
    """Joints of a robot that move another as well, and which: both are one drive. None where the robot has no others.

    Nor any that carries others of the robot's, as of an arm with parallel links: they would feel it stand where it does not.
    """
    ends = [joint for joint, carried in zip(robot.joints, robot.carried, strict=True) if not carried]
    found = {leader: joint for joint, leader in mimicking(robot.urdf).items() if leader in ends}
    return found if len(found) < robot.width else {}


def one_drive(led: Mapping[str, str]) -> str:
    """Why joints are left out that move others as well."""
    pairs = listed([f"{leader} moves {joint} as well, which mimics it" for leader, joint in led.items()])
    return f"{pairs}: left out, unless the parameter joints names it"
