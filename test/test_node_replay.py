"""The replay node: what it publishes, and in which order."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from live_support import environment, motion, real_robot

from bdnn_ros import bags
from bdnn_ros.robot import Robot

pytestmark = pytest.mark.ros

ARM = Robot.bundled("arm2")


@pytest.fixture
def player(tmp_path, monkeypatch):
    """Makes a replay node of this process, with these parameters."""
    import rclpy

    from bdnn_ros.nodes.replay import ReplayNode

    made = []

    def make(**parameters):
        arguments = [text for name, value in parameters.items() for text in ("-p", f"{name}:={value}")]
        rclpy.init(args=["--ros-args", "-p", "wait:=0.0", "-p", "rate:=100.0", *arguments], domain_id=191)
        made.append(ReplayNode())
        return made[-1]

    yield make
    for node in made:
        node.destroy_node()
    rclpy.try_shutdown()


def test_commands_come_as_recorded_before_their_joint_states(player, tmp_path, monkeypatch):
    """In the order of the description they would be another controller's."""
    recording = motion(real_robot(ARM), 0.4, 250.0)
    turned = replace(recording.select(ARM.joints[::-1]), urdf=ARM.urdf)
    sent, values = recording.time[10:] - 0.001, np.arange(270.0).reshape(90, 3)
    bag = bags.write(turned, tmp_path / "bag", commands=(sent, values))
    node = player(bag=bag, effort_commands_topic="/effort_commands")
    order = []
    monkeypatch.setattr(node._efforts, "publish", lambda message: order.append(list(message.data)))
    monkeypatch.setattr(node._states, "publish", lambda message: order.append(len(message.name)))
    node.play()
    expected = [2] * 10 + [what for row in values.tolist() for what in (row, 2)]
    assert order == expected


@pytest.mark.parametrize(
    ("parameters", "remedy"),
    [
        ({"joint_states_topic": "/js"}, "Choose it with joint_states_topic:=/joint_states."),
        (
            {"effort_commands_topic": "/x"},
            "Choose with effort_commands_topic:=/effort_commands, or use an empty effort_commands_topic.",
        ),
        ({"rename": "[ab]"}, "rename ab is not a rule. Use old=new or s/pattern/replacement/; a slash"),
    ],
)
def test_what_is_wrong_is_told_with_parameters(tmp_path, capfd, parameters, remedy):
    """It named options of the command line."""
    from bdnn_ros.nodes import replay

    recording = motion(ARM, 0.4, 250.0)
    bag = bags.write(recording, tmp_path / "bag", commands=(recording.time, recording.effort))
    arguments = [text for name, value in parameters.items() for text in ("-p", f"{name}:={value}")]
    ending = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in ending]
    assert replay.main(["--ros-args", "-p", f"bag:={bag}", *arguments]) in (1, 2)
    assert {signal.getsignal(number) for number in ending} == {signal.SIG_IGN}  # its end is not broken off
    for number, handler in zip(ending, before, strict=True):
        signal.signal(number, handler)
    said = capfd.readouterr().err
    assert remedy in said and "--" not in said


def test_no_service_is_offered_that_is_not_answered(player, tmp_path):
    """Those of the parameters: nothing is spun while a bag is played."""
    node = player(bag=bags.write(motion(ARM, 0.4, 250.0), tmp_path / "bag"))
    assert not [name for name in (service.srv_name for service in node.services) if "parameter" in name]


def test_a_bag_whose_first_states_are_left_out_is_played_at_once(player, tmp_path, monkeypatch):
    recording = motion(ARM, 0.4, 250.0)
    node = player(bag=bags.write(recording, tmp_path / "bag"))
    node.recording = replace(node.recording, time=node.recording.time + 3000.0)
    waits = []
    monkeypatch.setattr(
        node, "_sleep_until", lambda due: waits.append(due - time.perf_counter()) or len(waits) < 20
    )
    node.play()
    assert len(waits) == 20 and max(waits) < 1.0


def test_a_signal_ends_it_while_it_reads():
    """Any, as Ctrl-C does: a long bag is read for a minute, in which nobody asks ROS."""
    reading = (
        "import sys, time\n"
        "from bdnn_ros.nodes import replay\n"
        "replay.bags.read_to_play = lambda *_: [print('reading', flush=True), time.sleep(120.0)]\n"
        "sys.exit(replay.main(['--ros-args', '-p', 'bag:=x']))"
    )
    command = [sys.executable, "-c", reading]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment(221)) as node:
        assert node.stdout is not None and node.stdout.readline() == "reading\n"
        node.send_signal(signal.SIGTERM)
        try:
            assert node.wait(60.0) == 0
        finally:
            node.kill()


def test_ros_that_a_signal_ends_meanwhile_is_ended(monkeypatch):
    import rclpy

    from bdnn_ros.nodes import beginning

    def second() -> None:
        raise RuntimeError("failed to shutdown: rcl_shutdown already called on the given context")

    monkeypatch.setattr(rclpy, "try_shutdown", second)
    beginning.end()
