"""The replay node: what it publishes, and in which order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from live_support import motion, real_robot

from bdnn_ros import bags
from bdnn_ros.robot import Robot

pytestmark = pytest.mark.ros

ARM = Robot.bundled("arm2")


@pytest.fixture
def player(tmp_path, monkeypatch):
    """Makes a replay node of this process, with these parameters."""
    import rclpy

    from bdnn_ros.nodes.replay_node import ReplayNode

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
