"""`replay_node`: publishes the joint states of a bag with the bag's own stamps."""

from __future__ import annotations

import contextlib
import time
from typing import Any

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

from bdnn_ros import bags
from bdnn_ros.errors import UsageError
from bdnn_ros.nodes import parameters
from bdnn_ros.nodes.beginning import run
from bdnn_ros.nodes.conversions import stamp
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

NAME = "replay_node"
CLOCK_EVERY = 0.01
"""Time between messages on /clock, on the bag's clock [s]."""
LONGEST_NAP = 0.2
"""So often is looked whether to stop [s]."""
LOOP_PAUSE = 1_500_000_000
"""Stamps go on so much later in the next round [ns]: a listener sees a pause, not a clock that jumps back."""
OPTIONS = {
    "--effort measured": "an empty effort_commands_topic",
    "--joint-states ": "joint_states_topic:=",
    "--effort-commands ": "effort_commands_topic:=",
    "--rename": "rename",
}
"""Options of the command line, as remedies of what reads a bag name them, and the parameters here that stand for them."""


class ReplayNode(Node):
    """Reads the bag at start, waits for a subscriber, then plays.

    Raises:
        BdnnError: a parameter, the bag or the URDF cannot be used.
    """

    def __init__(self) -> None:
        super().__init__(NAME, start_parameter_services=False)  # nobody would answer while it plays
        settings = self.settings = parameters.Settings(self, parameters.REPLAY)
        if not settings["bag"]:
            raise UsageError("The parameter bag is not set.", "Pass --ros-args -p bag:=PATH.")
        command = settings["effort_commands_topic"]
        rename = settings["rename"]
        states = settings["joint_states_topic"]
        self.played = bags.read_to_play(settings["bag"], states, command, rename)
        self.recording = self.played.recording
        urdf = self.recording.urdf
        if settings["urdf_file"]:
            urdf = Robot.from_file(settings["urdf_file"]).urdf
        for note in self.recording.notes:
            self.get_logger().info(note)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._states = self.create_publisher(JointState, "joint_states", 1000)
        self._efforts = self.create_publisher(Float64MultiArray, "effort_commands", 1000) if command else None
        self._clock_topic = self.create_publisher(Clock, "/clock", 10) if settings["clock"] else None
        self._description = self.create_publisher(String, "robot_description", latched)
        if urdf:
            self._description.publish(String(data=urdf))
        else:
            self.get_logger().warning("The bag has no robot description; set urdf_file to publish one.")

    def play(self) -> None:
        """Play the bag once or in a loop; returns early when ROS shuts down."""
        self._wait()
        start = self.recording.epoch
        while rclpy.ok():
            played = self._play_once(start)
            if rclpy.ok():  # a log after the end of ROS is an error of its own
                self.get_logger().info(f"played {played} joint states")
            if not self.settings["loop"]:
                break
            start += round(self.recording.duration * 1e9) + LOOP_PAUSE
        with contextlib.suppress(Exception):  # a listener that went away is no concern of ours
            self._states.wait_for_all_acked(rclpy.duration.Duration(seconds=2))

    def _wait(self) -> None:
        end = time.monotonic() + self.settings["wait"]
        while rclpy.ok() and time.monotonic() < end and not self._states.get_subscription_count():
            rclpy.spin_once(self, timeout_sec=0.05)
        if not self._states.get_subscription_count():
            self.get_logger().warning("Nobody listens to joint_states; playing all the same.")

    def _play_once(self, start: int) -> int:
        recording, rate = self.recording, float(self.settings["rate"])
        stamps = start + np.round(recording.time * 1e9).astype(np.int64)
        rows = _Rows(recording)
        commands = self._commands()
        moments = recording.time.tolist()
        began = time.perf_counter() - next(iter(moments), 0.0) / rate  # the first states may be left out
        told = -np.inf
        for row, moment in enumerate(moments):
            while commands and commands[-1][0] <= row:
                _, due, values = commands.pop()
                if not self._sleep_until(began + due / rate):
                    return row
                self._efforts.publish(Float64MultiArray(data=values))  # type: ignore[union-attr]
            if not self._sleep_until(began + moment / rate):
                return row
            when = stamp(int(stamps[row]))
            if self._clock_topic is not None and moment - told >= CLOCK_EVERY:
                told = moment
                self._clock_topic.publish(Clock(clock=when))
            self._states.publish(rows.state(row, when))
        return len(recording)

    def _commands(self) -> list[tuple[int, float, np.ndarray]]:
        """For each command the row of the joint state it precedes, when it is due [s] and its values; the last one first."""
        played = self.played
        return list(zip(played.row.tolist(), played.due.tolist(), played.commands, strict=True))[::-1]

    @staticmethod
    def _sleep_until(due: float) -> bool:
        """Sleep; returns False if ROS shuts down meanwhile."""
        while (left := due - time.perf_counter()) > 0.0:
            time.sleep(min(left, LONGEST_NAP))
            if left > LONGEST_NAP and not rclpy.ok():
                return False
        return bool(rclpy.ok())


class _Rows:
    """Messages of the recording's rows."""

    def __init__(self, recording: Recording) -> None:
        self._names = list(recording.joints)
        self._position = recording.position.tolist()
        self._velocity = None if recording.velocity is None else recording.velocity.tolist()
        self._effort = None if recording.effort is None else recording.effort.tolist()

    def state(self, row: int, when: Time) -> JointState:
        """A joint state of this stamp."""
        message: Any = JointState()
        message.header.stamp = when
        message.name = self._names
        message.position = self._position[row]
        if self._velocity is not None:
            message.velocity = self._velocity[row]
        if self._effort is not None:
            message.effort = self._effort[row]
        return message


def _in_parameters(sentence: str) -> str:
    """The sentence with command-line options replaced by the parameters of this node."""
    for option, parameter in OPTIONS.items():
        sentence = sentence.replace(option, parameter)
    return sentence


def main(arguments: list[str] | None) -> int:
    """Run the node until it is shut down; returns the exit status."""
    return run(NAME, arguments, ReplayNode, _play, worded=lambda error: _in_parameters(str(error)))


def _play(node: ReplayNode) -> int:
    node.play()
    return 0
