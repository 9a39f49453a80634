"""The joints that the parameter `joints` names."""

from __future__ import annotations

import pytest

from bdnn_ros.errors import UsageError
from bdnn_ros.nodes.choosing import with_joints
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
    assert with_joints(robot, []) is robot
    assert with_joints(robot, ARM.joints).joints == ARM.joints


def test_an_unknown_joint_is_told_of_as_the_node_can_mend_it():
    with pytest.raises(
        UsageError, match=r"no movable joint elbow; it has arm6_joint1, .* parameter joints"
    ) as said:
        with_joints(ARM, ["arm6_joint1", "elbow"])
    assert "--rename" not in str(said.value)  # an option of the command line tool
