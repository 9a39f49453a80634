"""Transitions that fail: nothing of the node's is left over, the error is printed, and it can be configured anew."""

from __future__ import annotations

import os
import threading
import time
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from live_support import Robotics, children, urdf_file, wait_until
from std_msgs.msg import String

from bdnn_interfaces.srv import Diagnose, LoadModel, SaveModel
from bdnn_ros.errors import UsageError
from bdnn_ros.nodes import services
from bdnn_ros.online.session import Session
from bdnn_ros.robot import Robot

pytestmark = pytest.mark.ros

DOMAIN = 189
ARM = Robot.bundled("arm2")


@pytest.fixture
def node(tmp_path) -> Iterator[Any]:
    """An identification node in this process, which nobody spins."""
    import rclpy

    from bdnn_ros.nodes.identification import IdentificationNode

    urdf = urdf_file(tmp_path, ARM)
    rclpy.init(args=["--ros-args", "-p", f"urdf_file:={urdf}"], domain_id=DOMAIN)
    made = IdentificationNode()
    yield made
    made.finish()
    made.destroy_node()
    rclpy.try_shutdown()
    assert children(os.getpid()) == []


def state(node) -> str:
    return str(node._state_machine.current_state[1])


def fails(*arguments, **named):
    raise RuntimeError("on purpose")


@pytest.mark.parametrize("transition", ["configure", "activate", "deactivate", "cleanup", "shutdown"])
def test_after_an_error_nothing_goes_on_and_the_node_can_be_configured(node, monkeypatch, capfd, transition):
    from rclpy.lifecycle import TransitionCallbackReturn

    from bdnn_ros.nodes import identification

    before = len(list(node.services)), len(list(node.publishers)), len(list(node.timers))
    with monkeypatch.context() as patch:
        if transition == "configure":
            patch.setattr(identification, "Services", fails)
        else:
            assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
            if transition == "deactivate":
                assert node.trigger_activate() == TransitionCallbackReturn.SUCCESS
            where = {
                "activate": (node, "_every"),
                "deactivate": (node._lane, "do"),
                "cleanup": (node._lane, "forget"),
                "shutdown": (node._lane, "stop"),
            }
            patch.setattr(*where[transition], fails)
        supervisor = node._session.supervisor if node._session else None
        assert getattr(node, f"trigger_{transition}")() == TransitionCallbackReturn.ERROR
    assert state(node) == "unconfigured" and node._session is None
    assert "on purpose" in capfd.readouterr().err
    assert supervisor is None or supervisor.pid == 0
    wait_until(lambda: children(os.getpid()) == [], 2.0)
    if transition != "cleanup":  # there it is the withdrawing of services that fails
        assert (len(list(node.services)), len(list(node.publishers)), len(list(node.timers))) == before
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert state(node) == "inactive" and node._session.supervisor.trouble == ""


@pytest.mark.parametrize(
    ("asked", "named"),
    [({"id": 1}, "1"), ({"id": 2}, "2"), ({"id": 123}, "123"), ({"label": "activate"}, "activate")],
)
def test_a_transition_that_is_not_possible_is_refused(node, capfd, asked, named):
    """It ended the node."""
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState

    def change(**fields):
        request = ChangeState.Request(transition=Transition(**fields))
        return node._service_change_state.callback(request, ChangeState.Response()).success

    if asked == {"id": 2}:  # to clean up what was never configured; the others ask an active node
        assert not change(**asked) and state(node) == "unconfigured"
    else:
        assert change(label="configure") and change(id=Transition.TRANSITION_ACTIVATE)
        assert not change(**asked) and state(node) == "active"
        assert change(label="deactivate") and change(id=Transition.TRANSITION_CLEANUP)
    assert f"The transition {named} is not possible while the node is " in capfd.readouterr().err


def descriptors() -> set[tuple[str, str]]:
    """What this process holds open. A set: what earlier tests left for the collector may close at any time."""
    listed = ((entry.name, entry) for entry in Path("/proc/self/fd").iterdir())
    return {(number, os.readlink(entry)) for number, entry in listed if entry.is_symlink()}


def test_configuring_that_is_refused_leaves_nothing_open(node, monkeypatch):
    """Neither the session's pipe nor its rings, which are laid out where joints are given; nor its threads."""
    from rclpy.lifecycle import TransitionCallbackReturn
    from rclpy.parameter import Parameter

    from bdnn_ros.nodes import identification

    def refuse(session, robot):
        session.set_robot(robot)
        session.begin(robot.joints)
        raise UsageError("No.", "Do without.")

    monkeypatch.setattr(node, "_meet", refuse)
    sessions = []
    monkeypatch.setattr(
        identification, "Session", lambda *a, **k: sessions.append(Session(*a, **k)) or sessions[-1]
    )
    before = descriptors()
    for _ in range(3):
        assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
        assert state(node) == "unconfigured"
    assert len(sessions) == 3 and descriptors() <= before
    assert node.set_parameters([Parameter("cutoff", value=5.0)])[0].successful


def test_a_lane_that_has_stopped_holds_no_guard_condition(node):
    from rclpy.exceptions import InvalidHandle

    assert node.trigger_configure() == node.trigger_cleanup()
    with pytest.raises(InvalidHandle):
        node._lane._wake.trigger()


@pytest.mark.parametrize("turns", [1, 1000])
def test_who_waits_for_a_diagnosis_is_refused_when_the_node_is_cleaned_up(node, monkeypatch, turns):
    """The answer came to a service that was gone, and that ended the node.

    With an executor that comes late to the withdrawal the next set-up offered a second one.
    """
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState
    from rclpy.executors import SingleThreadedExecutor

    @types.coroutine
    def turn():
        yield from [None] * turns

    monkeypatch.setattr(services, "_turn", turn)
    node.trigger_configure()
    session = node._session
    monkeypatch.setattr(session, "diagnose", lambda window: session._requests.new()[1])  # never ready
    answers, executor = [], SingleThreadedExecutor()
    executor.add_node(node)

    def change(ros, transition):
        request = {"transition": Transition(id=transition)}
        return ros.call(ChangeState, "/identification_node/change_state", **request).success

    def ask(ros):
        answers.append(ros.call(Diagnose, "/identification_node/diagnose", 10.0))

    with Robotics(DOMAIN) as ros:
        client = threading.Thread(target=ask, args=(ros,), daemon=True)

        def converse():
            client.start()
            wait_until(lambda: session._requests._waiting)
            assert change(ros, Transition.TRANSITION_CLEANUP)
            client.join(11.0)
            assert change(ros, Transition.TRANSITION_CONFIGURE)
            answers.append("configured")

        other = threading.Thread(target=converse, daemon=True)
        other.start()
        end = time.monotonic() + 40.0
        while other.is_alive() and time.monotonic() < end:
            executor.spin_once(timeout_sec=0.1)
    assert len(answers) == 2 and answers[1] == "configured"
    assert not answers[0].success and "cleaned up" in answers[0].message
    assert len([service for service in node.services if "diagnose" in service.srv_name]) == 1
    executor.shutdown()


@pytest.mark.parametrize("kind", [Diagnose, SaveModel, LoadModel])
def test_what_is_asked_while_refusals_are_sent_is_refused(node, tmp_path, kind):
    """The services stay until then: to save or load with a session that had ended was the end of the node."""
    from rclpy.parameter import Parameter

    node.set_parameters([Parameter("model_directory", value=str(tmp_path))])
    node.trigger_configure()
    session, offered = node._session, node._offered
    session.save_now(tmp_path / "model.bdnn")
    handle = {service.srv_type: service.callback for service in offered._patient}[kind]
    node.trigger_cleanup()
    with pytest.raises(StopIteration) as ended:  # a coroutine's answer
        handle(kind.Request(), kind.Response()).send(None)
    answer = ended.value.value
    assert not answer.success and answer.message.startswith("The node is being cleaned up.")


@pytest.mark.parametrize("urdf", ["<robot name='x'/>", Robot.bundled("arm6").urdf])
def test_a_description_that_is_refused_does_not_hide_that_the_one_before_serves(node, monkeypatch, urdf):
    """It was told as an error until another description came, and hid whatever else was to be told."""
    assert node.start()
    node._session.begin(ARM.joints)
    told: list[Any] = []
    monkeypatch.setattr(node._publishing, "tell", lambda *arguments: told.append(arguments))
    node._on_description(String(data=urdf))
    node._keep_house()
    _, trouble, _, _, refused = told[-1]
    assert trouble == "" and refused.startswith("robot_description: ")
    assert node._session.robot.joints == ARM.joints
    node._on_description(String(data=ARM.urdf))
    node._keep_house()
    assert told[-1][1] == told[-1][4] == ""


def test_an_error_in_what_is_told_every_second_does_not_end_the_node(node, monkeypatch, capfd):
    """It is logged once with where it came from; at the end of ROS any call fails, which is nobody's error."""
    import rclpy

    def broken(*arguments: Any) -> None:
        raise ValueError("of a race")

    assert node.start()
    monkeypatch.setattr(node._publishing, "tell", broken)
    node._keep_house()
    node._keep_house()
    logged = capfd.readouterr().err
    assert logged.count("ValueError: of a race") == 1 and "Traceback" in logged and "_tell" in logged
    rclpy.shutdown()
    with pytest.raises(ValueError, match="of a race"):  # `main` ends in silence
        node._keep_house()


def test_a_complaint_about_names_goes_once_the_joints_are_known(node):
    """Also where they are known by a parameter, after a clean-up or with the description."""
    import rclpy
    from rclpy.parameter import Parameter

    assert node.trigger_configure() == rclpy.lifecycle.TransitionCallbackReturn.SUCCESS
    assert not node._choose_joints(["gripper"]) and "gripper" in node._complained
    node.trigger_cleanup()
    node.trigger_configure()
    assert node._complained == ""
    assert not node._choose_joints(["gripper"]) and node._complained
    node.trigger_cleanup()
    node.set_parameters([Parameter("joints", value=list(ARM.joints))])
    node.trigger_configure()
    assert node._complained == "" and node._session.intake.joints == ARM.joints
