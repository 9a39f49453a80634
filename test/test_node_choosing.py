"""The joints that the parameter `joints` names."""

from __future__ import annotations

import pytest

from bdnn_ros.errors import RobotError, UsageError
from bdnn_ros.nodes.choosing import leading, one_drive, with_joints
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm6")


def test_joints_are_chosen_in_the_order_given():
    assert with_joints(ARM, []) is ARM
    assert with_joints(ARM, ["arm6_joint3", "arm6_joint1"]).joints == ("arm6_joint3", "arm6_joint1")


def test_a_joint_that_mimics_another_is_used_where_it_is_named():
    urdf = ARM.urdf.replace(
        '<joint name="arm6_joint6" type="revolute">',
        '<joint name="arm6_joint6" type="revolute"><mimic joint="arm6_joint5"/>',
    )
    robot = Robot.from_urdf(urdf)
    assert robot.joints == ARM.joints[:5]
    assert with_joints(robot, ARM.joints).joints == ARM.joints


def hand(mount: str) -> Robot:
    """The arm with two fingers on a link, of which the second mimics the first."""
    body = '<inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>'
    fingers = "".join(
        f"""<link name="{name}_tip">{body}</link><joint name="{name}" type="prismatic"><parent link="{mount}"/>
        <child link="{name}_tip"/><axis xyz="1 0 0"/><limit lower="0" upper="0.04" velocity="0.1" effort="20"/>
        {mimic}</joint>"""
        for name, mimic in (("left", ""), ("right", '<mimic joint="left"/>'))
    )
    return Robot.from_urdf(ARM.urdf.replace("</robot>", f"{fingers}</robot>"))


def test_a_finger_that_moves_the_other_one_is_left_out_unless_it_is_named():
    """Both are one drive, whose friction and rotor would be told of the one that is seen; from a bag it is the same."""
    robot = hand("arm6_tool")
    assert robot.joints == (*ARM.joints, "left") and leading(robot) == {"left": "right"}
    assert with_joints(robot, []).joints == ARM.joints
    assert with_joints(robot, ["left", "arm6_joint1"]).joints == ("left", "arm6_joint1")
    assert one_drive(leading(robot)).startswith("left moves right as well, which mimics it: left out")


def test_a_joint_that_moves_another_and_carries_the_arm_is_used():
    urdf = hand("arm6_tool").urdf.replace('<mimic joint="left"/>', '<mimic joint="arm6_joint2"/>')
    robot = Robot.from_urdf(urdf)
    assert leading(robot) == {} and with_joints(robot, []) is robot


def test_a_gripper_alone_is_used():
    robot = Robot.from_urdf(hand("arm6_tool").urdf, ["left"])
    assert leading(robot) == {} and with_joints(robot, []) is robot


def test_a_robot_that_may_roam_is_used_where_its_arm_is_named():
    roaming = ARM.urdf.replace(
        "</robot>",
        '<link name="world"/><joint name="wheels" type="planar"><parent link="world"/>'
        f'<child link="{ARM.links[0]}"/><axis xyz="0 0 1"/></joint></robot>',
    )
    robot = Robot.from_urdf(roaming)
    assert with_joints(robot, ARM.joints).joints == ARM.joints
    with pytest.raises(RobotError, match=r"more than one degree of freedom \(wheels\)"):
        with_joints(robot, [])


def test_an_unknown_joint_is_told_of_as_the_node_can_mend_it():
    with pytest.raises(
        UsageError, match=r"no movable joint elbow; it has arm6_joint1, .* parameter joints"
    ) as said:
        with_joints(ARM, ["arm6_joint1", "elbow"])
    assert "--rename" not in str(said.value)  # an option of the command line tool
