"""Selection of the joints that the identification node uses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bdnn_ros.errors import UsageError, listed
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mimics import mimicking, with_mimics
from bdnn_ros.robot.urdf import refuse_free


def with_joints(robot: Robot, joints: Sequence[str]) -> Robot:
    """The robot with these joints only, in this order.

    Without names: all movable joints except mimic joints and the leaders that `leading` finds.

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
    """Joints that other joints mimic, so that one drive moves two joints, with the mimic joint of each.

    Left out are leaders that carry further joints of the robot, as in an arm with parallel links: those joints would feel the
    leader stand where it does not. Empty if the robot has no other joints.
    """
    ends = [joint for joint, carried in zip(robot.joints, robot.carried, strict=True) if not carried]
    found = {leader: joint for joint, leader in mimicking(robot.urdf).items() if leader in ends}
    return found if len(found) < robot.width else {}


def one_drive(led: Mapping[str, str]) -> str:
    """The message that says why leaders of mimic joints are left out."""
    pairs = listed([f"{leader} moves {joint} as well, which mimics it" for leader, joint in led.items()])
    return f"{pairs}: left out, unless the parameter joints names it"
