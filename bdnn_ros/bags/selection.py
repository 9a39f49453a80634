"""Which topics and joints to read from a bag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bdnn_ros.bags.left_over import subject
from bdnn_ros.errors import UsageError, listed


@dataclass(frozen=True)
class Selection:
    """What to read from a bag.

    Attributes:
        joint_states: topic of sensor_msgs/JointState.
        effort_commands: topic of std_msgs/Float64MultiArray; None takes the only one in the bag.
        effort: "measured" reads JointState.effort; "command" takes the last command recorded before each joint state,
            unless it is older than `efforts.COMMAND_AGE`. The values of a command belong, in this order, to `joints`,
            to `robot_joints` (or those of the description in the bag) or to the joints of the messages: the first of
            these lists that has their length.
        rename: rules as in `Recording.rename`, applied before joints are selected.
        joints: the joints to read, in this order; all are required. With effort commands, joints that no message holds
            only mark a place among the command's values.
        robot_joints: used when `joints` is empty: those of these joints that are in the bag are read, in this order,
            except those whose messages cannot be merged with the others. When both are empty, the robot description in
            the bag decides; without one, all joints of the most common kind of message are read.
    """

    joint_states: str = "/joint_states"
    effort_commands: str | None = None
    effort: str = "measured"
    rename: Sequence[str] = ()
    joints: Sequence[str] = ()
    robot_joints: Sequence[str] = ()

    def __post_init__(self) -> None:
        if self.effort not in ("measured", "command"):
            raise UsageError(
                f"The effort is measured or command, not {self.effort!r}.", "Choose one of these."
            )


def available_joints(
    name: str, joints: Sequence[str], robot_joints: Sequence[str], every: Sequence[str], main: Sequence[str]
) -> tuple[str, ...]:
    """The joints to read from a bag.

    Args:
        name: the bag's, for the message.
        joints, robot_joints: as of `Selection`.
        every: all joints in the bag.
        main: those of the most common kind of message.

    Raises:
        UsageError: one of `joints` is not in the bag, or is named twice.
    """
    if joints:
        missing = [joint for joint in joints if joint not in every]
        if missing:
            raise UsageError(
                f"{name}: {subject(missing)} not in the recording, which has {listed(every, 20)}.",
                "Name the joints with --joints, or map the names with --rename old=new.",
            )
        if len(set(joints)) != len(joints):
            raise UsageError(f"A joint is named twice in {listed(joints, 20)}.", "Name each joint once.")
        return tuple(joints)
    return tuple(joint for joint in robot_joints if joint in every) or tuple(main)
