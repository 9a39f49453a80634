"""ROS conventions: lifecycle, parameters, namespaces, simulated time, commanded efforts, the replay node."""

from __future__ import annotations

import re
import signal
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
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
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParameters
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import Trigger

from bdnn_interfaces.msg import DynamicsEstimate
from bdnn_interfaces.srv import Diagnose, InverseDynamics, SaveModel
from bdnn_ros import bags
from bdnn_ros.models import load_model
from bdnn_ros.nodes.parameters import IDENTIFICATION, REPLAY
from bdnn_ros.robot import Robot

pytestmark = pytest.mark.ros

NODE = "/identification_node"
ARM = Robot.bundled("arm2")
REAL = real_robot(ARM)
ROOT = Path(__file__).resolve().parent.parent


def change(ros: Robotics, transition: int) -> bool:
    return ros.call(ChangeState, f"{NODE}/change_state", transition=Transition(id=transition)).success


def state(ros: Robotics) -> int:
    return ros.call(GetState, f"{NODE}/get_state").current_state.id


@pytest.mark.slow
def test_lifecycle_and_parameters(tmp_path):
    with node_process(tmp_path, 121, autostart=False) as node, Robotics(121) as ros:
        assert state(ros) == State.PRIMARY_STATE_UNCONFIGURED
        names = [setting.name for setting in IDENTIFICATION]
        told = ros.call(DescribeParameters, f"{NODE}/describe_parameters", names=names).descriptors
        assert all(descriptor.description for descriptor in told)
        ranges = {d.name: d for d in told}
        assert ranges["cutoff"].floating_point_range[0].to_value == 500.0
        assert ranges["trainer_niceness"].integer_range[0].to_value == 19

        def put(name: str, **value) -> str:
            parameter = Parameter(name=name, value=ParameterValue(**value))
            result = ros.call(SetParameters, f"{NODE}/set_parameters", parameters=[parameter]).results[0]
            return "" if result.successful else result.reason or "?"

        double, text = ParameterType.PARAMETER_DOUBLE, ParameterType.PARAMETER_STRING
        assert put("cutoff", type=double, double_value=-1.0)
        assert "measured" in put("effort_source", type=text, string_value="guessed")
        assert put("cutoff", type=double, double_value=8.0) == ""
        assert put("urdf_file", type=text, string_value=str(tmp_path / "none.urdf")) == ""
        assert not change(ros, Transition.TRANSITION_CONFIGURE)
        assert "none.urdf" in node.output
        assert put("urdf_file", type=text, string_value=str(urdf_file(tmp_path, ARM))) == ""
        assert change(ros, Transition.TRANSITION_CONFIGURE)
        assert state(ros) == State.PRIMARY_STATE_INACTIVE
        assert "configuration" in put("cutoff", type=double, double_value=9.0)
        # inactive, it answers but does not listen
        assert ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **pose(ARM)).success
        assert not ros.node.get_subscriptions_info_by_topic("/joint_states")
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        assert change(ros, Transition.TRANSITION_ACTIVATE)
        ros.stream(motion(REAL, 2.0, 250.0), speed=2.0)
        wait_until(lambda: diagnostics and status(diagnostics)["samples_received"] == "500")
        boolean = ParameterType.PARAMETER_BOOL
        assert put("training", type=boolean, bool_value=False) == ""
        wait_until(lambda: status(diagnostics)["training"] == "false")
        assert change(ros, Transition.TRANSITION_DEACTIVATE)
        wait_until(lambda: not ros.node.get_subscriptions_info_by_topic("/joint_states"))
        assert node.children()
        assert change(ros, Transition.TRANSITION_CLEANUP)
        assert not node.children()
        assert change(ros, Transition.TRANSITION_CONFIGURE) and change(ros, Transition.TRANSITION_ACTIVATE)
        assert state(ros) == State.PRIMARY_STATE_ACTIVE
        assert change(ros, Transition.TRANSITION_ACTIVE_SHUTDOWN)
        assert not node.children()
        assert state(ros) == State.PRIMARY_STATE_FINALIZED


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("effort_source", "guessed", "effort_source is 'guessed'; it must be one of measured, command."),
        ("trainer_niceness", "40", "trainer_niceness is 40; it must lie between 0 and 19."),
        ("cutoff", "ten", "cutoff is 'ten'; it must be a number with a decimal point."),
    ],
)
def test_a_bad_value_at_start_gets_a_sentence(tmp_path, name, value, said):
    arguments = [sys.executable, "-m", "bdnn_ros.nodes.identification_node", "--ros-args", "-p"]
    process = Process([*arguments, f"{name}:={value}"], tmp_path / "log", 122)
    assert process.process.wait(30) == 2
    assert said in process.output and "Traceback" not in process.output


@pytest.mark.parametrize(
    ("file", "settings"), [("identification_node", IDENTIFICATION), ("replay_node", REPLAY)]
)
def test_the_configuration_files_hold_every_default(file, settings):
    loaded = yaml.safe_load((ROOT / "config" / f"{file}.yaml").read_text())["/**"][file]["ros__parameters"]
    empty = {setting.name: setting.default for setting in settings if setting.default == []}
    assert {**empty, **loaded} == {setting.name: setting.default for setting in settings}


@pytest.mark.slow
@pytest.mark.parametrize("whole", [True, False], ids=["whole efforts", "turned, halved, without gravity"])
def test_namespace_remapping_simulated_time_and_commands(tmp_path, whole):
    """In a namespace, on another topic, with /clock for time and the effort that was commanded."""
    arguments = [sys.executable, "-m", "bdnn_ros.nodes.identification_node", "--ros-args"]
    arguments += ["-r", "__ns:=/cell_1", "-r", "effort_commands:=/arm_controller/commands"]
    settings = {
        "use_sim_time": "true",
        "effort_source": "command",
        "joints": f"[{', '.join(ARM.joints)}]",
        "diagnosis_period": "0.0",
    }
    if not whole:
        settings |= {"effort_factors": "['-2']", "add_gravity": "true"}
    for name, value in settings.items():
        arguments += ["-p", f"{name}:={value}"]
    recording = motion(REAL, 6.5, 250.0)
    acting = recording.require_effort()
    commands = acting if whole else (acting - ARM.gravity(recording.position)) / -2.0
    process = Process(arguments, tmp_path / "log", 123)
    try:
        with Robotics(123) as ros:
            diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
            estimates = ros.keep(DynamicsEstimate, "/cell_1/identification_node/estimate")
            ros.publisher(String, "/cell_1/robot_description", latched=True).publish(String(data=ARM.urdf))
            commander = ros.publisher(Float64MultiArray, "/arm_controller/commands")

            def command(row, message):
                commander.publish(Float64MultiArray(data=commands[row].tolist()))
                message.effort = []
                return message

            ros.stream(recording, topic="/cell_1/joint_states", start=5_000_000_000, change=command)
            wait_until(lambda: diagnostics and status(diagnostics)["samples_received"] == "1625")
            wait_until(lambda: int(status(diagnostics)["model_version"]) >= 4)
            assert status(diagnostics)["samples_rejected"] == "0"
            asked = {k: np.array(v) for k, v in pose(ARM).items()}
            answer = ros.call(InverseDynamics, "/cell_1/identification_node/inverse_dynamics", **pose(ARM))
            np.testing.assert_allclose(answer.effort, REAL.inverse_dynamics(**asked), rtol=0.03, atol=0.03)
            told = estimates[-1]
            assert 5 < told.header.stamp.sec < 12 and len(told.effort_measured) == 2
    finally:
        process.end()
        print(process.output)


@pytest.mark.slow
def test_a_stream_and_a_description_that_do_not_go_together_are_told(tmp_path):
    """A diagnosis says how they differ, and what to do; put right and reset, there is nothing to tell."""
    recording = motion(REAL, 16.0, 250.0, noise=0.003)
    turned = replace(recording, effort=recording.require_effort() * [1.0, -1.0])
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "diagnosis_period": 0.0}
    with node_process(tmp_path, 126, **parameters) as node, Robotics(126) as ros:
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        ros.stream(turned, speed=8.0)
        wait_until(lambda: diagnostics and status(diagnostics)["samples_buffered"] == "0")
        answer = ros.call(Diagnose, f"{NODE}/diagnose", window=0.0)
        assert not answer.success and f"--effort-factor {ARM.joints[1]}=-1" in answer.message
        ros.stream(turned, speed=8.0, start=1100 * 10**9)
        wait_until(lambda: status(diagnostics)["message"] == answer.message)
        assert status(diagnostics)["level"] == "1"
        wait_until(lambda: answer.message in node.output)  # its log is read beside the topics
        assert ros.call(Trigger, f"{NODE}/reset").success
        ros.stream(recording, speed=8.0, start=2000 * 10**9)
        wait_until(lambda: status(diagnostics)["message"] == "training")
        assert ros.call(Diagnose, f"{NODE}/diagnose", window=0.0).success
        wait_until(lambda: status(diagnostics)["message"] != answer.message)


def test_three_processes_play_learn_and_ask(tmp_path):
    """One process plays a bag at 500 Hz, one learns, this one asks: the answer is the offline model's."""
    recording = motion(REAL, 3.0, 500.0, noise=0.003)
    bags.write(recording, tmp_path / "bag")
    with (
        node_process(tmp_path, 124, diagnosis_period=0.0, model_directory=tmp_path / "models"),
        Robotics(124) as ros,
    ):
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        estimates = ros.keep(DynamicsEstimate, f"{NODE}/estimate")
        arguments = [sys.executable, "-m", "bdnn_ros.nodes.replay_node", "--ros-args"]
        arguments += ["-p", f"bag:={tmp_path / 'bag'}", "-p", "clock:=true"]
        player = Process(arguments, tmp_path / "player.log", 124)
        assert player.process.wait(60) == 0, player.output
        wait_until(lambda: diagnostics and status(diagnostics)["samples_received"] == "1500")
        assert status(diagnostics)["samples_lost"] == "0"
        assert re.search(r"played 1500 joint states", player.output)
        wait_until(lambda: int(status(diagnostics)["model_version"]) >= 1)
        assert ros.call(SaveModel, f"{NODE}/save_model", name="played").success
        offline = load_model(tmp_path / "models" / "played")
        asked = pose(ARM, 0.4)
        answer = ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **asked)
        expected = offline.inverse_dynamics(*(np.array(values) for values in asked.values()))
        np.testing.assert_allclose(answer.effort, expected, atol=1e-5)
        stamps = {message.header.stamp.sec for message in estimates}
        original = bags.read(tmp_path / "bag").epoch // 10**9
        assert stamps <= set(range(original, original + 4))


def test_the_replay_node_says_what_is_wrong(tmp_path):
    arguments = [sys.executable, "-m", "bdnn_ros.nodes.replay_node", "--ros-args", "-p", "bag:=/none.mcap"]
    player = Process(arguments, tmp_path / "player.log", 125)
    assert player.process.wait(30) == 2
    assert "/none.mcap" in player.output and "Traceback" not in player.output
    assert signal.SIGINT
