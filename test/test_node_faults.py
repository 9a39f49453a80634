"""What happens in a lab, with real processes over DDS: the node names it and goes on."""

from __future__ import annotations

import os
import resource
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_support import (
    Process,
    Robotics,
    motion,
    node_process,
    pose,
    real_robot,
    status,
    urdf_file,
    wait_until,
)
from std_msgs.msg import String

from bdnn_interfaces.srv import InverseDynamics, SaveModel
from bdnn_ros import bags
from bdnn_ros.cli.replay import replayed
from bdnn_ros.models import load_model, save_model
from bdnn_ros.online.learning import Learning
from bdnn_ros.online.serving import nominal
from bdnn_ros.robot import Robot

pytestmark = pytest.mark.ros

NODE = "/identification_node"
ARM = Robot.bundled("arm2")
REAL = real_robot(ARM)
SECOND = 1_000_000_000


def gone(pid: int) -> bool:
    return not Path(f"/proc/{pid}").exists()


def shared_memory() -> set[str]:
    """What lies in shared memory but for the middleware's own, which other tests use at the same time."""
    names = os.listdir("/dev/shm")  # noqa: S108
    return {name for name in names if "fastrtps" not in name and "fastdds" not in name}


@pytest.mark.slow
def test_the_trainer_is_killed(tmp_path):
    """It is started again, the last model serves on, and the end is as if nothing had happened."""
    recording = motion(REAL, 9.0, 250.0)
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "model_directory": tmp_path, "diagnosis_period": 0.0}
    with node_process(tmp_path, 131, **parameters) as node, Robotics(131) as ros:
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        killed = []

        def kill(row, message):
            if row == 1000:
                killed.extend(node.children())
                os.kill(killed[0], signal.SIGKILL)
                before = ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **pose(ARM))
                assert before.success and before.model_version > 0
            return message

        ros.stream(recording, change=kill)
        wait_until(lambda: diagnostics and status(diagnostics)["samples_received"] == "2250")
        wait_until(lambda: status(diagnostics)["trainer_alive"] == "true", 20.0)
        told = status(diagnostics)
        assert told["samples_lost"] == told["samples_rejected"] == told["samples_unlearned"] == "0"
        assert told["trainer_restarts"] == "1"
        assert gone(killed[0]) and len(node.children()) == 1
        wait_until(lambda: status(diagnostics)["samples_buffered"] == "0")
        trainer = node.children()[0]
        assert node.end(signal.SIGTERM) == 0
    assert gone(trainer)
    learning = Learning(ARM)
    for _ in replayed(learning, recording):
        pass
    np.testing.assert_allclose(
        load_model(tmp_path).parameters.vector(),
        learning.served.model.parameters.vector(),
        rtol=1e-6,
        atol=1e-9,
    )


@pytest.mark.slow
def test_a_stream_with_faults(tmp_path):
    """NaN, infinite, short and foreign messages, joints in other orders, no effort, clocks that jump."""
    with node_process(tmp_path, 132, diagnosis_period=0.0) as node, Robotics(132) as ros:
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")

        def told(key: str) -> int:
            return int(status(diagnostics).get(key, "0"))

        description = ros.publisher(String, "robot_description", latched=True)
        description.publish(String(data="<robot name='broken'><link"))
        # it also waits for a description by this name, which is no error
        wait_until(lambda: diagnostics and status(diagnostics)["level"] == "2")
        assert "robot_description" in status(diagnostics)["message"]
        description.publish(String(data=ARM.urdf))
        wait_until(lambda: "joint states" in status(diagnostics)["message"])

        def spoil(row, message):
            if row == 10:
                message.position[0] = float("nan")
            elif row == 20:
                message.effort[1] = float("inf")
            elif row == 30:
                message.position = message.position[:1]
            elif row == 40:
                message.name = [ARM.joints[0], "somebody_else"]
            elif row == 50:
                message.name = ["gripper_left", "gripper_right"]
            elif row == 60:
                message.header.stamp.sec -= 0
                message.header.stamp.nanosec = max(message.header.stamp.nanosec - 100_000_000, 0)
            elif 100 <= row < 200:  # joints in another order, one more between
                message.name = [ARM.joints[1], "gripper_left", ARM.joints[0]]
                for field in ("position", "velocity", "effort"):
                    first, second = getattr(message, field)
                    setattr(message, field, [second, 9.0, first])
            elif 200 <= row < 300:
                message.effort = [] if row % 2 else [float("nan")] * 2
            elif 300 <= row < 305:
                return None  # lost on the way
            return message

        recording = motion(REAL, 4.0, 250.0)
        ros.stream(recording, change=spoil)
        wait_until(lambda: told("samples_received") == 1000 - 5 - 1)
        assert told("rejected_not_finite") == 2
        assert told("rejected_wrong_length") == 1
        assert told("rejected_joints_missing") == 1
        assert told("rejected_stamp_backwards") == 1
        assert told("rejected_effort_missing") == 100
        assert told("samples_rejected") == 105
        assert told("samples_lost") == 5 + 1  # what was rejected is none of these: it came
        # the publisher dies and returns; the clock jumps back, then forward; learning goes on
        version = told("model_version")
        ros.stream(recording, start=900 * SECOND)
        wait_until(lambda: told("stream_clock_restarts") == 1)
        ros.stream(recording, start=5000 * SECOND)
        wait_until(lambda: told("stream_pauses") == 1)
        wait_until(lambda: told("model_version") > version)
        true = REAL.inverse_dynamics(**{key: np.array(value) for key, value in pose(ARM).items()})

        def learned() -> bool:
            answer = ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **pose(ARM))
            return np.allclose(answer.effort, true, rtol=0.03, atol=0.03)

        wait_until(learned)
        # a burst of what the queue holds, five times as fast as the robot's own 1 kHz: nothing is lost, however busy the machine
        ros.stream(motion(REAL, 0.9, 1000.0), speed=5.0, start=6000 * SECOND)
        wait_until(lambda: told("samples_received") == 994 + 2 * 1000 + 900, timeout=30.0)
        assert told("stream_messages_lost") == 0
        # a description of another robot does not replace the one in use
        description.publish(String(data=Robot.bundled("arm6").urdf))
        wait_until(lambda: "another robot" in node.output)
        assert ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **pose(ARM)).success


@pytest.mark.slow
def test_the_publisher_is_killed_and_returns(tmp_path):
    """A process that plays a bag dies without a word; another begins the bag anew: learning goes on."""
    bags.write(replace(motion(REAL, 6.0, 250.0), epoch=1000 * SECOND), tmp_path / "bag")
    arguments = [
        sys.executable,
        "-m",
        "bdnn_ros.nodes.replay_node",
        "--ros-args",
        "-p",
        f"bag:={tmp_path / 'bag'}",
    ]
    with node_process(tmp_path, 138, diagnosis_period=0.0), Robotics(138) as ros:
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")

        def told(key: str) -> int:
            return int(status(diagnostics).get(key, "0")) if diagnostics else 0

        first = Process(arguments, tmp_path / "first.log", 138)
        wait_until(lambda: told("samples_received") > 500, 30.0)
        first.process.kill()
        first.process.wait()
        wait_until(lambda: "no joint state for" in status(diagnostics)["message"], 20.0)
        before, version = told("samples_received"), told("model_version")
        assert ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **pose(ARM)).success
        second = Process(arguments, tmp_path / "second.log", 138)
        assert second.process.wait(60) == 0, second.output
        wait_until(lambda: told("samples_received") == before + 1500)
        assert told("stream_clock_restarts") == 1 and told("samples_lost") == 0
        wait_until(lambda: told("model_version") > version)


def test_a_directory_that_cannot_hold_models(tmp_path):
    """A directory that is a file: refused at start, before anything is learned in vain."""
    blocked = tmp_path / "blocked"
    blocked.write_text("a file")
    with node_process(tmp_path, 133, model_directory=blocked) as node:
        assert node.process.wait(60) == 2
        assert "cannot be written to model_directory" in node.output and node.output.count("\n") == 1
    assert blocked.read_text() == "a file"


@pytest.mark.slow
def test_a_model_that_can_no_longer_be_written(tmp_path):
    """A directory that became a file: refused with a sentence, and the node goes on."""
    kept = tmp_path / "kept"
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "diagnosis_period": 0.0}
    with node_process(tmp_path, 167, model_directory=kept, **parameters) as node, Robotics(167) as ros:
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        ros.stream(motion(REAL, 3.0, 250.0))
        wait_until(lambda: diagnostics and int(status(diagnostics)["model_version"]) >= 1)
        kept.rmdir()
        kept.write_text("a file")
        answer = ros.call(SaveModel, f"{NODE}/save_model", name="x")
        assert answer.success is False and "cannot be written" in answer.message
        assert ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **pose(ARM)).success
        assert node.end() == 0
        assert "cannot be written" in node.output and "rosout" not in node.output
    assert kept.read_text() == "a file"


@pytest.mark.slow
def test_another_arms_model_survives(tmp_path):
    """It cannot be gone on from, and is not written over: what is learned is saved beside it."""
    other = save_model(tmp_path / "kept", nominal(Robot.bundled("arm6")))
    before = other.read_bytes()
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "model_directory": tmp_path / "kept"}
    with node_process(tmp_path, 168, diagnosis_period=0.0, **parameters) as node, Robotics(168) as ros:
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        ros.stream(motion(REAL, 3.0, 250.0))
        wait_until(lambda: diagnostics and int(status(diagnostics)["model_version"]) >= 1)
        answer = ros.call(SaveModel, f"{NODE}/save_model", name="")
        assert answer.success and "model_2.bdnn" in answer.message
        assert node.end() == 0
        assert f"not going on from {other}, which is left as it is" in node.output
        assert f"model saved to {other.with_name('model_2.bdnn')}\n" in node.output
        assert "rosout" not in node.output
    assert other.read_bytes() == before
    assert load_model(other.with_name("model_2.bdnn")).joints == ARM.joints


@pytest.mark.slow
def test_the_disk_is_full_in_the_middle_of_a_save(tmp_path):
    """The write fails half-way: a sentence, the model saved before stays whole, nothing is left beside it."""
    kept = tmp_path / "kept"
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "model_directory": kept, "diagnosis_period": 0.0}
    with node_process(tmp_path, 137, **parameters) as node, Robotics(137) as ros:
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        ros.stream(motion(REAL, 3.0, 250.0))
        wait_until(lambda: diagnostics and int(status(diagnostics)["model_version"]) >= 1)
        assert ros.call(SaveModel, f"{NODE}/save_model", name="x").success
        whole = (kept / "x" / "model.bdnn").read_bytes()
        free = resource.prlimit(node.pid, resource.RLIMIT_FSIZE)
        assert len(whole) > 4096
        resource.prlimit(node.pid, resource.RLIMIT_FSIZE, (4096, free[1]))  # SIGXFSZ is ignored by Python
        for name in ("x", "new"):
            answer = ros.call(SaveModel, f"{NODE}/save_model", name=name)
            assert answer.success is False
            assert "cannot be written" in answer.message and "File too large" in answer.message
            assert "\n" not in answer.message
        resource.prlimit(node.pid, resource.RLIMIT_FSIZE, free)
        assert (kept / "x" / "model.bdnn").read_bytes() == whole
        assert sorted(path.name for path in kept.rglob("*")) == ["model.bdnn", "new", "x"]
        assert ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **pose(ARM)).success
        assert ros.call(SaveModel, f"{NODE}/save_model", name="x").success
        assert node.end() == 0
    assert load_model(kept / "x").joints == load_model(kept).joints == ARM.joints


@pytest.fixture
def _in_a_terminal():
    """As without nohup, which whoever runs the tests may have used: what it ignores its children ignore."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.slow
@pytest.mark.usefixtures("_in_a_terminal")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_leaves_nothing_behind(tmp_path, number):
    """No process, no shared memory of ours, and a whole model file."""
    before = shared_memory()
    domain = {signal.SIGINT: 134, signal.SIGTERM: 135, signal.SIGHUP: 184}[number]
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "model_directory": tmp_path, "diagnosis_period": 0.0}
    with node_process(tmp_path, domain, **parameters) as node, Robotics(domain) as ros:
        ros.stream(motion(REAL, 2.5, 250.0))
        trainer = node.children()
        began = time.monotonic()
        assert node.end(number) == 0
        assert time.monotonic() - began < 10.0
    assert trainer and all(gone(pid) for pid in trainer)
    assert shared_memory() <= before
    assert load_model(tmp_path).joints == ARM.joints
    assert [path.name for path in tmp_path.glob(".model*")] == []


def test_the_node_is_killed(tmp_path):
    """The trainer does not outlive it."""
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "diagnosis_period": 0.0}
    with node_process(tmp_path, 136, **parameters) as node:
        trainer = wait_until(node.children, 20.0)
        time.sleep(2.0)
        os.kill(node.pid, signal.SIGKILL)
        node.process.wait()
        wait_until(lambda: all(gone(pid) for pid in trainer), 10.0)
