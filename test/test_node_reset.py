"""~/reset, and another description: nothing that was said of what is forgotten stands any longer."""

from __future__ import annotations

import re
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_support import (
    Robotics,
    children,
    motion,
    node_process,
    pose,
    real_robot,
    status,
    urdf_file,
    wait_until,
)
from std_msgs.msg import String
from std_srvs.srv import Trigger

from bdnn_interfaces.msg import Findings
from bdnn_interfaces.srv import Diagnose, InverseDynamics
from bdnn_ros.robot import Robot

pytestmark = pytest.mark.ros

NODE = "/identification_node"
ARM = Robot.bundled("arm2")
REAL = real_robot(ARM)


@pytest.mark.slow
def test_a_reset_takes_back_errors_and_findings(tmp_path):
    """Also those of a diagnosis that was under way; its asker gets the answer, but it does not stand."""
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "diagnosis_period": 0.0, "training": False}
    with node_process(tmp_path, 162, **parameters) as node, Robotics(162) as ros:
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        findings = ros.keep(Findings, f"{NODE}/findings", latched=True)
        ros.stream(motion(REAL, 12.0, 100.0, noise=0.002), speed=4.0)
        wait_until(lambda: diagnostics and status(diagnostics)["samples_received"] == "1200")
        assert float(status(diagnostics)["effort_nrmse"]) > 0.0
        assert f"effort_nrmse_{ARM.joints[0]}" in status(diagnostics)
        assert not findings  # at start nothing is said
        assert ros.call(Diagnose, f"{NODE}/diagnose", window=0.0).findings.findings
        wait_until(lambda: findings and findings[-1].findings)
        (trainer,) = node.children()
        wait_until(lambda: not children(trainer))
        with ThreadPoolExecutor(1) as aside:
            under_way = aside.submit(ros.call, Diagnose, f"{NODE}/diagnose", window=0.0)
            wait_until(lambda: children(trainer))  # the process of the diagnosis
            told = len(findings)
            assert ros.call(Trigger, f"{NODE}/reset").success
            assert under_way.result(120.0).success
        seen = len(diagnostics)
        wait_until(lambda: len(diagnostics) >= seen + 3)
        assert [(message.verdict, len(message.findings)) for message in findings[told:]] == [
            ("cannot_tell", 0)
        ]
        assert status(diagnostics)["effort_nrmse"] == "nan"
        assert f"effort_nrmse_{ARM.joints[0]}" not in status(diagnostics)
        late = ros.keep(Findings, f"{NODE}/findings", latched=True)
        (message,) = wait_until(lambda: late)
        assert message.verdict == "cannot_tell" and not message.findings and message.gain == 0.0
        assert "diagnose" in message.advice[0]


@pytest.mark.slow
def test_another_description_of_the_same_joints_is_taken_over(tmp_path):
    """It serves, learning begins again, and the log says so, once; the same description again changes nothing."""
    with node_process(tmp_path, 169, diagnosis_period=0.0, training=False) as node, Robotics(169) as ros:
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        description = ros.publisher(String, "robot_description", latched=True)
        description.publish(String(data=ARM.urdf))
        ros.stream(motion(REAL, 2.0, 250.0))
        wait_until(lambda: diagnostics and status(diagnostics)["samples_received"] == "500")
        gravity = ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **pose(ARM)).gravity
        description.publish(String(data=ARM.urdf))
        time.sleep(1.0)
        assert "robot_description has changed" not in node.output
        heavier = re.sub(r'(<mass value=")([0-9.]+)', lambda m: f"{m[1]}{2.0 * float(m[2])}", ARM.urdf)
        description.publish(String(data=heavier))
        wait_until(lambda: "robot_description has changed" in node.output)
        answer = ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **pose(ARM))
        np.testing.assert_allclose(answer.gravity, 2.0 * np.array(gravity))
        assert node.output.count("robot_description has changed") == 1 and answer.model_version == 0


@pytest.mark.slow
def test_without_a_robot_there_is_nothing_to_reset(tmp_path):
    with node_process(tmp_path, 163), Robotics(163) as ros:
        for _ in range(2):
            answer = ros.call(Trigger, f"{NODE}/reset")
            assert answer.success is False and "robot_description" in answer.message
