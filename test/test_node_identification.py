"""The identification node as a process: what it learns, publishes, answers and refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_support import (
    FIRST_STAMP,
    Robotics,
    motion,
    node_process,
    pose,
    real_robot,
    status,
    urdf_file,
    wait_until,
)
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from bdnn_interfaces.msg import DynamicsEstimate
from bdnn_interfaces.srv import Diagnose, ForwardDynamics, InverseDynamics, LoadModel, SaveModel
from bdnn_ros.cli.replay import replayed
from bdnn_ros.models import load_model
from bdnn_ros.online.learning import Learning
from bdnn_ros.robot import Robot

pytestmark = pytest.mark.ros

NODE = "/identification_node"
ARM = Robot.bundled("arm2")
REAL = real_robot(ARM)


def test_first_light(tmp_path):
    """Streamed at 500 Hz: nothing is lost, and the live model is the one that a replay gives."""
    arm = Robot.bundled("arm7")
    real = real_robot(arm)
    recording = motion(real, 5.0, 500.0, noise=0.003)
    with (
        node_process(tmp_path, 101, model_directory=tmp_path / "models", diagnosis_period=0.0) as node,
        Robotics(101) as ros,
    ):
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        estimates = ros.keep(DynamicsEstimate, f"{NODE}/estimate")
        efforts = ros.keep(JointState, f"{NODE}/effort_estimate")
        ros.publisher(String, "robot_description", latched=True).publish(String(data=arm.urdf))
        ros.stream(recording.part(slice(0, 900)))
        wait_until(lambda: diagnostics and int(status(diagnostics)["model_version"]) >= 1)
        # the error told is of the last 3 s: all of them are estimated by a model that has learned
        ros.stream(recording.part(slice(900, None)), start=FIRST_STAMP + 1_800_000_000)
        wait_until(lambda: status(diagnostics)["samples_received"] == "2500")
        wait_until(lambda: int(status(diagnostics)["model_version"]) >= 3)
        told = status(diagnostics)
        assert told["samples_lost"] == "0" and told["samples_rejected"] == "0"
        assert told["trainer_alive"] == "true"
        assert float(told["effort_nrmse"]) < 0.3
        assert ros.call(SaveModel, f"{NODE}/save_model", name="live").success
        kept = load_model(tmp_path / "models" / "live")
        generator = np.random.default_rng(0)
        for _ in range(5):
            asked = {
                name: generator.uniform(-1, 1, 7).tolist()
                for name in ("position", "velocity", "acceleration")
            }
            answer = ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **asked)
            assert answer.success, answer.message
            offline = kept.inverse_dynamics(*(np.array(x) for x in asked.values()))
            np.testing.assert_allclose(answer.effort, offline, atol=1e-5)
            M = np.reshape(answer.mass_matrix, (7, 7))
            together = (
                M @ asked["acceleration"]
                + np.add(answer.coriolis, answer.gravity)
                + np.array(answer.friction)
            )
            np.testing.assert_allclose(together, answer.effort, atol=1e-9)
            assert np.linalg.eigvalsh(M).min() > 0
            back = ros.call(
                ForwardDynamics,
                f"{NODE}/forward_dynamics",
                position=asked["position"],
                velocity=asked["velocity"],
                effort=answer.effort,
            )
            np.testing.assert_allclose(back.acceleration, asked["acceleration"], atol=1e-8)
        told = estimates[-1]
        parts = np.sum([told.inertial, told.coriolis, told.gravity, told.friction, told.learned], axis=0)
        np.testing.assert_allclose(parts, told.effort_estimate, atol=1e-9)
        assert list(told.joint_names) == list(arm.joints) and len(told.mass_matrix) == 49
        assert np.all(np.array(told.effort_std) > 0)
        assert efforts[-1].name == list(arm.joints)
        assert (tmp_path / "models" / "live" / "model.bdnn").is_file()
        trainer = node.children()
        assert len(trainer) == 1
        assert node.end() == 0
    assert not Path(f"/proc/{trainer[0]}").exists()
    # what was saved at the end is what a replay of the same samples ends with
    learning = Learning(Robot.from_urdf(arm.urdf))
    for _ in replayed(learning, recording):
        pass
    final = load_model(tmp_path / "models")
    assert learning.served is not None
    np.testing.assert_allclose(
        final.parameters.vector(), learning.served.model.parameters.vector(), rtol=1e-6, atol=1e-9
    )


def test_refusals_name_what_is_wrong(tmp_path):
    with (
        node_process(
            tmp_path,
            102,
            urdf_file=urdf_file(tmp_path, ARM),
            joints="[arm2_joint1, arm2_joint2]",
            training=False,
            diagnosis_period=0.0,
        ),
        Robotics(102) as ros,
    ):
        a, b = ARM.joints
        asked = pose(ARM)

        def ask(kind, service, /, **changes):
            answer = ros.call(kind, f"{NODE}/{service}", **changes)
            assert answer.success is False
            return answer.message

        inverse, forward = InverseDynamics, ForwardDynamics
        assert "nose" in ask(inverse, "inverse_dynamics", **{**asked, "joint_names": ["nose", b]})
        assert b in ask(inverse, "inverse_dynamics", **{**asked, "joint_names": [a]})
        assert "twice" in ask(inverse, "inverse_dynamics", **{**asked, "joint_names": [a, a]})
        assert "velocity has 1" in ask(inverse, "inverse_dynamics", **{**asked, "velocity": [1.0]})
        assert "acceleration has 0" in ask(inverse, "inverse_dynamics", **{**asked, "acceleration": []})
        nan = float("nan")
        assert f"position of {b}" in ask(inverse, "inverse_dynamics", **{**asked, "position": [0.0, nan]})
        moved = {"position": [0.0, 0.0], "velocity": [0.0, 0.0], "effort": [float("inf"), 0.0]}
        assert f"effort of {a}" in ask(forward, "forward_dynamics", **moved)
        assert "no robot's" in ask(inverse, "inverse_dynamics", **{**asked, "velocity": [1e200, 0.0]})
        moved["effort"] = [1e308, 1e308]
        assert "no robot's" in ask(forward, "forward_dynamics", **moved)
        assert "window" in ask(Diagnose, "diagnose", window=-1.0)
        wait_until(lambda: "No joint state" in ask(Diagnose, "diagnose", window=0.0), 20.0)
        assert "model_directory" in ask(SaveModel, "save_model", name="x")
        assert "model_directory" in ask(LoadModel, "load_model", name="x")
        # joints in the request's order, and the node goes on
        asked = {"position": [0.1, -0.4], "velocity": [0.5, 0.2], "acceleration": [1.0, -2.0]}
        one = ros.call(inverse, f"{NODE}/inverse_dynamics", **asked)
        turned = {name: numbers[::-1] for name, numbers in asked.items()}
        other = ros.call(inverse, f"{NODE}/inverse_dynamics", joint_names=[b, a], **turned)
        assert one.success and other.success and other.joint_names == [b, a]
        np.testing.assert_allclose(one.effort, other.effort[::-1])
        np.testing.assert_allclose(
            np.reshape(one.mass_matrix, (2, 2)), np.reshape(other.mass_matrix, (2, 2))[::-1, ::-1]
        )
        np.testing.assert_allclose(one.effort, ARM.inverse_dynamics(*(np.array(x) for x in asked.values())))
