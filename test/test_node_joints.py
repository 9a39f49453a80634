"""Joints that come in several messages, or late, with real processes over DDS: the most that come together are used."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_support import Robotics, motion, node_process, pose, real_robot, status, urdf_file, wait_until
from sensor_msgs.msg import JointState

from bdnn_interfaces.srv import InverseDynamics
from bdnn_ros.models import load_model, save_model
from bdnn_ros.online.serving import nominal
from bdnn_ros.robot import Robot

pytestmark = pytest.mark.ros

NODE = "/identification_node"
ARM = Robot.bundled("arm2")
REAL = real_robot(ARM)
GRIPPER = """
  <joint name="gripper" type="prismatic">
    <parent link="arm2_tool"/> <child link="finger"/> <axis xyz="1 0 0"/>
    <limit lower="0" upper="0.04" velocity="0.1" effort="20"/>
  </joint>
  <link name="finger">
    <inertial><mass value="0.01"/><inertia ixx="1e-6" ixy="0" ixz="0" iyy="1e-6" iyz="0" izz="1e-6"/></inertial>
  </link>
</robot>"""


def rings(pid: int) -> int:
    """How many rings a process holds open."""
    held = [os.readlink(entry) for entry in Path(f"/proc/{pid}/fd").iterdir() if entry.is_symlink()]
    held += Path(f"/proc/{pid}/maps").read_text().splitlines()
    return sum("bdnn_ring" in name for name in held)


@pytest.mark.slow
def test_a_gripper_that_comes_first_does_not_win(tmp_path):
    """The arm takes over as soon as it comes, with the model kept of it; the gripper's messages are told of."""
    arm = Robot.from_urdf(ARM.urdf.replace("</robot>", GRIPPER))
    save_model(tmp_path / "kept", nominal(Robot.from_urdf(arm.urdf, ARM.joints)))
    parameters = {"urdf_file": urdf_file(tmp_path, arm), "model_directory": tmp_path / "kept"}
    recording = motion(REAL, 6.0, 250.0)
    with node_process(tmp_path, 151, diagnosis_period=0.0, **parameters) as node, Robotics(151) as ros:
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        alone = ros.publisher(JointState, "joint_states")

        def with_gripper(row, message):
            if row % 5 == 0:
                fields = {"position": [0.01], "velocity": [0.0], "effort": [0.5]}
                alone.publish(JointState(header=message.header, name=["gripper"], **fields))
            return None if row < 250 else message

        ros.stream(recording, change=with_gripper)
        assert "identifying gripper\n" in node.output
        joints = ", ".join(ARM.joints)
        assert node.output.count("anew") == node.output.count(f"identifying {joints}, anew") == 1
        assert f"going on from {tmp_path / 'kept'}" in node.output
        wait_until(lambda: status(diagnostics)["samples_buffered"] == "0")
        wait_until(lambda: int(status(diagnostics)["model_version"]) >= 3)
        told = [message.status[0].message for message in diagnostics]
        assert any("Other messages hold gripper, at another rate" in message for message in told)
        assert int(status(diagnostics)["samples_received"]) > 900
        assert status(diagnostics)["samples_rejected"] == "0"
        answer = ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **pose(ARM))
        asked = {key: np.array(value) for key, value in pose(ARM).items()}
        assert answer.success and list(answer.joint_names) == list(ARM.joints)
        np.testing.assert_allclose(answer.effort, REAL.inverse_dynamics(**asked), rtol=0.03, atol=0.03)
        (trainer,) = node.children()
        assert rings(node.pid) == 3 and rings(trainer) == 2  # one each: mapping, its descriptor, and our own
        assert node.end() == 0
    assert load_model(tmp_path / "kept").joints == ARM.joints


@pytest.mark.slow
def test_a_gripper_that_nobody_publishes_is_told_of(tmp_path):
    """In /diagnostics and, once, in the log, with what to set; that set, there is nothing to tell."""
    arm = Robot.from_urdf(ARM.urdf.replace("</robot>", GRIPPER))
    parameters = {"urdf_file": urdf_file(tmp_path, arm), "diagnosis_period": 0.0}
    joints = f"[{', '.join(ARM.joints)}]"
    with node_process(tmp_path, 165, **parameters) as node, Robotics(165) as ros:
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        ros.stream(motion(REAL, 7.0, 250.0))
        told = [message.status[0] for message in diagnostics]
        warned = [
            t for t in told if t.message.startswith("No message holds gripper of the robot description")
        ]
        assert warned and warned[-1].level == b"\1" and f"parameter joints to {joints}" in warned[-1].message
        assert status(diagnostics)["joints_left_out"] == "gripper"
        assert node.output.count("No message holds gripper") == 1
        wait_until(lambda: int(status(diagnostics)["model_version"]) >= 3)
        assert ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **pose(ARM)).success
    with node_process(tmp_path, 166, joints=joints, **parameters) as node, Robotics(166) as ros:
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        ros.stream(motion(REAL, 5.0, 250.0))
        assert status(diagnostics)["message"] == "training" and status(diagnostics)["joints_left_out"] == ""
        assert "gripper" not in node.output


@pytest.mark.slow
def test_a_finger_that_moves_the_other_one_is_told_to_be_left_out(tmp_path):
    other = GRIPPER.replace('"gripper"', '"other"').replace('"finger"', '"other_finger"')
    other = other.replace("</joint>", '<mimic joint="gripper"/></joint>')
    hand = ARM.urdf.replace("</robot>", GRIPPER.replace("</robot>", other))
    with node_process(tmp_path, 170, urdf_file=urdf_file(tmp_path, Robot.from_urdf(hand))) as node:
        with Robotics(170) as ros:
            diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
            ros.stream(motion(REAL, 0.2, 250.0))
            wait_until(lambda: f"identifying {', '.join(ARM.joints)}\n" in node.output)
            wait_until(lambda: diagnostics and status(diagnostics)["joints_left_out"] == "gripper")
        assert "gripper moves other as well, which mimics it: left out" in node.output


@pytest.mark.slow
def test_an_arm_in_two_messages_is_one_robot(tmp_path):
    """Two controllers publish a joint each; their messages are put together, and one that stops is told of."""
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "diagnosis_period": 0.0}
    recording = motion(REAL, 9.0, 250.0)
    with node_process(tmp_path, 152, **parameters) as node, Robotics(152) as ros:
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        second = ros.publisher(JointState, "joint_states")
        versions = []

        def halved(row, message):
            for joint in (1, 0):
                half = JointState(header=message.header, name=[ARM.joints[joint]])
                for field in ("position", "velocity", "effort"):
                    setattr(half, field, [getattr(message, field)[joint]])
                if joint == 1 and row < 1500:
                    second.publish(half)
            if row == 1500:
                # however fast the machine: three times while both joints come
                wait_until(lambda: int(status(diagnostics)["model_version"]) >= 3)
                versions.append(int(status(diagnostics)["model_version"]))
                assert status(diagnostics)["message"] == "training"
                assert int(status(diagnostics)["samples_received"]) > 900
                assert int(status(diagnostics)["samples_rejected"]) <= 2
            return half

        ros.stream(recording, change=halved)
        assert versions[0] >= 3
        told = [message.status[0] for message in diagnostics]
        assert any(
            t.message.startswith(f"No message holds {ARM.joints[1]}.") and t.level == b"\1" for t in told
        )
        wait_until(lambda: int(status(diagnostics).get("rejected_joints_missing", "0")) > 700)
        assert node.output.count("anew") == 1
        answer = ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **pose(ARM))
        asked = {key: np.array(value) for key, value in pose(ARM).items()}
        np.testing.assert_allclose(answer.effort, REAL.inverse_dynamics(**asked), rtol=0.03, atol=0.03)
