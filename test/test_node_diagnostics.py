"""What /diagnostics says of several nodes, of a publisher that is not heard, and of stamps that are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from live_support import Robotics, motion, node_process, real_robot, status, urdf_file, wait_until
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from bdnn_interfaces.msg import DynamicsEstimate
from bdnn_ros.nodes import diagnostics
from bdnn_ros.nodes.diagnostics import setup
from bdnn_ros.nodes.error_now import ErrorNow
from bdnn_ros.online.serving import Settings, nominal
from bdnn_ros.online.session import Session
from bdnn_ros.online.supervisor import Supervisor
from bdnn_ros.robot import Robot

pytestmark = pytest.mark.ros

ARM = Robot.bundled("arm2")
REAL = real_robot(ARM)


@pytest.mark.slow
def test_two_nodes_can_be_told_apart(tmp_path):
    domain = 181
    (tmp_path / "left").mkdir()
    (tmp_path / "right").mkdir()
    with (
        node_process(tmp_path / "left", domain, namespace="/left"),
        node_process(tmp_path / "right", domain, namespace="/right"),
        Robotics(domain) as ros,
    ):
        kept = ros.keep(DiagnosticArray, "/diagnostics")
        names = {"/left/identification_node", "/right/identification_node"}
        wait_until(lambda: {message.status[0].hardware_id for message in kept} == names, 30.0)
        assert {message.status[0].name for message in kept} == {"bdnn: identification"}


@pytest.mark.slow
def test_a_publisher_that_is_not_heard_is_told_of(tmp_path):
    domain = 182
    with node_process(tmp_path, domain, urdf_file=urdf_file(tmp_path, ARM)) as node, Robotics(domain) as ros:
        kept = ros.keep(DiagnosticArray, "/diagnostics")
        profile = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        deaf = ros.node.create_publisher(JointState, "joint_states", profile)
        told = "A publisher of /joint_states offers best effort only"
        wait_until(lambda: kept and told in status(kept)["message"], 30.0)
        assert "reliability to best_effort" in status(kept)["message"] and status(kept)["level"] == "1"
        assert status(kept)["samples_received"] == "0" and told in node.output
        ros.node.destroy_publisher(deaf)
        wait_until(lambda: told not in status(kept)["message"], 10.0)


def test_how_a_robot_is_set_up_is_told_where_motion_showed_it():
    level = nominal(ARM)
    leaning = replace(level, robot=ARM.tilted(*np.radians([2.5, -4.0])), tilt_std=(0.001, 0.001))
    assert setup(ARM) == setup(level) == {}
    assert setup(leaning) == {"base_roll_deg": "2.50", "base_pitch_deg": "-4.00"}
    off = replace(level, robot=replace(ARM, zeros=np.array([0.0, 0.05])), zeros_std=(0.0, 0.001))
    assert setup(off) == {"zero_of_arm2_joint2": "0.0500"}


def test_silence_is_told_with_the_names_that_come_instead_and_logged_once_each_time(monkeypatch):
    """Beside a stream that goes on, or where the node does not listen, strange names are nobody's business."""
    now, logged = [0.0], []
    monkeypatch.setattr(diagnostics.time, "monotonic", lambda: now[0])
    session = Session(Settings())
    session.set_robot(ARM)
    session.begin(ARM.joints)
    reporter = diagnostics.Reporter(session, logged.append, "/node")

    def told(seconds: float, active: bool = True) -> str:
        now[0] += seconds
        return reporter.status(ErrorNow(), active, "", 0).message

    monkeypatch.setattr(Supervisor, "alive", False)
    assert "no joint state" not in told(30.0) and logged == []  # nobody listens before the trainer is there
    monkeypatch.setattr(Supervisor, "alive", True)
    names, stamp = list(ARM.joints), 10**18
    for _ in range(2):
        session.watch.strange = "joint_states has x."
        session.intake.take(names, [0.0, 0.0], (), (), (stamp := stamp + 10**7), stamp)
        before = len(logged)
        assert "no joint state" not in told(11.0) and len(logged) == before
        session.watch.strange = ""
        assert told(3.0) == "no joint state for 3 s"
        session.watch.strange = "joint_states has x."
        assert told(11.0) == told(0.0) == "no joint state for 14 s. joint_states has x."
        assert logged[before:] == ["No joint state comes.", "No joint state comes. joint_states has x."]
        assert told(30.0) and len(logged) == before + 2
        told(30.0, active=False)
        assert "no joint state" not in told(1.0) and len(logged) == before + 2
    session.stop()


@pytest.mark.slow
def test_the_error_is_told_where_no_estimates_are_published(tmp_path):
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "estimate_rate": 0.0}
    with node_process(tmp_path, 210, **parameters), Robotics(210) as ros:
        kept = ros.keep(DiagnosticArray, "/diagnostics")
        estimates = ros.keep(DynamicsEstimate, "/identification_node/estimate")
        ros.stream(motion(REAL, 4.0, 250.0))
        wait_until(lambda: kept and status(kept)["effort_nrmse"] != "nan")
        assert float(status(kept)["effort_nrmse"]) > 0.0 and not estimates


@pytest.mark.slow
def test_stamps_that_are_none_are_told_of(tmp_path):
    domain = 183

    def unstamped(row, message):
        message.header.stamp = Time()
        return message

    with node_process(tmp_path, domain, urdf_file=urdf_file(tmp_path, ARM)) as node, Robotics(domain) as ros:
        kept = ros.keep(DiagnosticArray, "/diagnostics")
        ros.stream(motion(REAL, 4.0, 250.0), change=unstamped)
        told = "joint_states comes without stamps"
        assert any(told in message.status[0].message for message in kept) and node.output.count(told) == 1
        ros.stream(motion(REAL, 4.0, 250.0), start=2_000_000_000_000_000_000)
        wait_until(lambda: told not in status(kept)["message"], 10.0)
