"""What the `ros2` command line asks of the node, asked through rclpy: every verb of it that a team would use.

run, node info, topic echo and hz, a call of every service, param list, describe, get, set and dump, lifecycle
nodes, list, get and set.
"""

from __future__ import annotations

import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from live_support import Robotics, motion, node_process, pose, real_robot, status, urdf_file, wait_until
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import parameter_value_to_python
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from bdnn_interfaces.msg import DynamicsEstimate, Findings
from bdnn_interfaces.srv import Diagnose, ForwardDynamics, InverseDynamics, LoadModel, SaveModel
from bdnn_ros.models import load_model
from bdnn_ros.nodes.parameters import IDENTIFICATION
from bdnn_ros.robot import Robot

pytestmark = pytest.mark.ros

NODE = "/identification_node"
ARM = Robot.bundled("arm2")
REAL = real_robot(ARM)
PUBLISHED = {
    f"{NODE}/estimate": "bdnn_interfaces/msg/DynamicsEstimate",
    f"{NODE}/effort_estimate": "sensor_msgs/msg/JointState",
    f"{NODE}/findings": "bdnn_interfaces/msg/Findings",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}
HEARD = {"/joint_states": "sensor_msgs/msg/JointState", "/robot_description": "std_msgs/msg/String"}
SERVED = {
    f"{NODE}/inverse_dynamics": InverseDynamics,
    f"{NODE}/forward_dynamics": ForwardDynamics,
    f"{NODE}/diagnose": Diagnose,
    f"{NODE}/save_model": SaveModel,
    f"{NODE}/load_model": LoadModel,
    f"{NODE}/reset": Trigger,
    f"{NODE}/set_training": SetBool,
}


def types(kind: type) -> list[str]:
    package, _, _ = kind.__module__.partition(".")
    return [f"{package}/srv/{kind.__name__}"]


@pytest.mark.slow
def test_every_verb(tmp_path):
    with (
        node_process(tmp_path, 142, model_directory=tmp_path / "models", diagnosis_period=0.0),
        Robotics(142) as ros,
    ):
        info = ros.node
        # ros2 node list, node info
        wait_until(lambda: ("identification_node", "/") in info.get_node_names_and_namespaces(), 20.0)
        about = ("identification_node", "/")
        from std_msgs.msg import String

        ros.publisher(String, "robot_description", latched=True).publish(String(data=ARM.urdf))
        wait_until(
            lambda: (
                HEARD.items()
                <= {k: v[0] for k, v in info.get_subscriber_names_and_types_by_node(*about)}.items()
            ),
            20.0,
        )
        published = {k: v[0] for k, v in info.get_publisher_names_and_types_by_node(*about)}
        assert PUBLISHED.items() <= published.items()
        offered = dict(info.get_service_names_and_types_by_node(*about))
        assert {name: offered.get(name) for name in SERVED} == {n: types(k) for n, k in SERVED.items()}
        # ros2 topic echo, topic hz
        estimates = ros.keep(DynamicsEstimate, f"{NODE}/estimate")
        efforts = ros.keep(JointState, f"{NODE}/effort_estimate")
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        findings = ros.keep(Findings, f"{NODE}/findings", latched=True)
        ros.stream(motion(REAL, 12.0, 200.0, noise=0.002), speed=2.0)
        wait_until(lambda: diagnostics and status(diagnostics)["samples_received"] == "2400")
        wait_until(lambda: int(status(diagnostics)["model_version"]) >= 3, 20.0)
        stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in estimates]
        assert len(estimates) > 100 and np.all(np.diff(stamps) > 0)
        assert efforts[-1].name == list(ARM.joints)
        began, count = time.monotonic(), len(diagnostics)
        wait_until(lambda: len(diagnostics) >= count + 3, 10.0)
        assert 1.5 < time.monotonic() - began < 5.0
        # ros2 service call, every one
        assert ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **pose(ARM)).success
        still = {"position": [0.1, 0.2], "velocity": [0.0, 0.0], "effort": [0.0, 0.0]}
        assert ros.call(ForwardDynamics, f"{NODE}/forward_dynamics", **still).success
        assert ros.call(Diagnose, f"{NODE}/diagnose", timeout=90.0, window=0.0).success
        wait_until(lambda: findings)
        assert ros.call(SaveModel, f"{NODE}/save_model", name="a").success
        assert ros.call(LoadModel, f"{NODE}/load_model", name="a").success
        assert ros.call(SetBool, f"{NODE}/set_training", data=False).success
        assert ros.call(Trigger, f"{NODE}/reset").success
        # ros2 param list, describe, dump, get, set
        names = [setting.name for setting in IDENTIFICATION]
        listed = ros.call(ListParameters, f"{NODE}/list_parameters").result.names
        assert set(names) < set(listed) and "use_sim_time" in listed
        described = ros.call(DescribeParameters, f"{NODE}/describe_parameters", names=names).descriptors
        for setting, descriptor in zip(IDENTIFICATION, described, strict=True):
            ranged = descriptor.integer_range or descriptor.floating_point_range
            assert descriptor.description and bool(ranged) == (setting.low is not None)
            assert bool(descriptor.additional_constraints) == bool(setting.choices)
        got = ros.call(GetParameters, f"{NODE}/get_parameters", names=names).values
        dumped = {name: parameter_value_to_python(value) for name, value in zip(names, got, strict=True)}
        defaults = {s.name: s.default for s in IDENTIFICATION}
        changed = {"model_directory": str(tmp_path / "models"), "diagnosis_period": 0.0, "training": False}
        assert {k: list(v) if isinstance(defaults[k], list) else v for k, v in dumped.items()} == {
            **defaults,
            **changed,
        }
        on = ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=True)
        set_ = ros.call(
            SetParameters, f"{NODE}/set_parameters", parameters=[Parameter(name="training", value=on)]
        )
        assert set_.results[0].successful
        wait_until(lambda: status(diagnostics)["training"] == "true")
        # ros2 lifecycle nodes, get, list, set
        assert ros.call(GetState, f"{NODE}/get_state").current_state.label == "active"
        available = ros.call(GetAvailableTransitions, f"{NODE}/get_available_transitions")
        assert {t.transition.label for t in available.available_transitions} >= {"deactivate"}
        for number, label in (
            (Transition.TRANSITION_DEACTIVATE, "inactive"),
            (Transition.TRANSITION_ACTIVATE, "active"),
        ):
            assert ros.call(ChangeState, f"{NODE}/change_state", transition=Transition(id=number)).success
            assert ros.call(GetState, f"{NODE}/get_state").current_state.label == label


@pytest.mark.slow
def test_what_was_learned_outlives_a_node_that_is_killed(tmp_path):
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "model_directory": tmp_path, "save_period": 1.0}
    with node_process(tmp_path, 183, diagnosis_period=0.0, **parameters) as node, Robotics(183) as ros:
        ros.stream(motion(REAL, 5.0, 200.0, noise=0.002))
        wait_until(lambda: (tmp_path / "model.bdnn").exists())
        node.process.kill()
        node.process.wait()
    model = load_model(tmp_path / "model.bdnn")
    assert model.joints == ARM.joints and model.kind == "physical"
    assert [path.name for path in tmp_path.glob("*.bdnn*")] == ["model.bdnn"]


@pytest.mark.slow
def test_training_resumes_from_the_model_that_was_kept(tmp_path):
    """The next node predicts its first motion as well as the last one did, and learns on from there."""
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "model_directory": tmp_path, "diagnosis_period": 0.0}
    with node_process(tmp_path, 143, **parameters) as node, Robotics(143) as ros:
        ros.stream(motion(REAL, 8.0, 200.0, noise=0.002), speed=2.0)
        assert node.end() == 0
    first = []
    with node_process(tmp_path, 144, **parameters) as node, Robotics(144) as ros:
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        estimates = ros.keep(DynamicsEstimate, f"{NODE}/estimate")
        ros.stream(motion(REAL, 6.0, 200.0, seed=5, noise=0.002))
        assert "going on from" in node.output
        versions = [message.model_version for message in estimates]
        assert min(versions) >= 1 and max(versions) > min(versions)
        first = [m for m in estimates if m.model_version == min(versions)]
        measured, told, *moved = (
            np.array([getattr(message, name) for message in first])
            for name in ("effort_measured", "effort_estimate", "position", "velocity", "acceleration")
        )
        described = ARM.inverse_dynamics(*moved)
        wrong, right = (np.sqrt(np.mean((measured - x) ** 2, axis=0)) for x in (described, told))
        assert np.all(right < 0.5 * wrong), (right, wrong)
        wait_until(lambda: diagnostics and int(status(diagnostics)["model_version"]) > min(versions))
