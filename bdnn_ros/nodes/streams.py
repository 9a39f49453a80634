"""The subscriptions to joint states and effort commands; their callbacks copy, and never wait."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from bdnn_ros.nodes.lane import Lane
from bdnn_ros.online.session import Session

NOT_HEARD = "A publisher of {} offers best effort only: nothing comes from it. Set the parameter reliability to best_effort."


class Streams:
    """Creates the subscriptions; `close` takes them away again.

    The executor takes joint states until the joints are fixed, then the lane does.

    Args:
        node: to create them on.
        lane: takes the messages.
        session: that takes the samples.
        choose: asked to fix the joints by the names in the first joint states, until it says that it has; and
            again where more of the robot's joints come.
        profile: quality of service.
        commands: whether effort commands are listened to.

    Attributes:
        lost: messages the middleware says it lost.
        complaint: which publisher is not heard, and what to do; empty if all are.
    """

    def __init__(
        self,
        node: Node,
        lane: Lane,
        session: Session,
        choose: Callable[[Sequence[str]], bool],
        profile: QoSProfile,
        commands: bool,
    ) -> None:
        self.lost = 0
        self.complaint = ""
        self._incompatible = False
        self._node = node
        self._lane = lane
        self._session = session
        self._choose = choose
        self._commands: Any = None
        if commands:
            self._commands = node.create_subscription(
                Float64MultiArray, "effort_commands", self._on_command, profile, callback_group=lane.group()
            )
        events = SubscriptionEventCallbacks(
            message_lost=self._on_lost, incompatible_qos=self._on_incompatible_qos
        )
        self._states = node.create_subscription(
            JointState,
            "joint_states",
            self._on_joint_state,
            profile,
            callback_group=lane.group(),
            event_callbacks=events,
        )
        self._joints_are_fixed()

    def look_around(self) -> None:
        """Begin anew where more of the robot's joints come than are in use; meanwhile the queue keeps messages."""
        self._look_for_unheard()
        joints = self._session.wider()
        if joints:
            self._lane.forget(self._states)  # commands come in an order that was given: these joints stay
            self._choose(joints)
            self._joints_are_fixed()

    def close(self) -> None:
        """Take the subscriptions away."""
        for subscription in (self._states, self._commands):
            if subscription is not None:
                self._lane.forget(subscription)
                self._node.destroy_subscription(subscription)

    def _on_joint_state(self, message: JointState, info: dict[str, int]) -> None:
        if self._session.intake is not None or self._choose(message.name):
            self._take(message, info)
            self._joints_are_fixed()

    def _joints_are_fixed(self) -> None:
        """Hand the stream over to the lane, if they are."""
        if self._session.intake is not None and not self._lane.holds(self._states):
            if self._commands is not None:
                self._lane.listen(self._commands, self._on_command)
            self._lane.listen(self._states, self._take)

    def _take(self, message: JointState, info: dict[str, int]) -> None:
        stamp = message.header.stamp
        self._session.intake.take(  # type: ignore[union-attr]
            message.name,
            message.position,
            message.velocity,
            message.effort,
            stamp.sec * 1_000_000_000 + stamp.nanosec,
            info["source_timestamp"],
        )

    def _on_command(self, message: Float64MultiArray, info: dict[str, int]) -> None:
        if self._session.commands is not None:
            self._session.commands.take(message.data, info["source_timestamp"])

    def _look_for_unheard(self) -> None:
        """After an event, as long as such a publisher is there: no event tells that it has gone."""
        if self._incompatible:
            topic = self._states.topic_name
            publishers = self._node.get_publishers_info_by_topic(topic)
            unheard = any(p.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT for p in publishers)
            self.complaint = NOT_HEARD.format(topic) if unheard else ""
            self._incompatible = unheard

    def _on_incompatible_qos(self, event: Any) -> None:
        self._incompatible = True

    def _on_lost(self, event: Any) -> None:
        self.lost = int(event.total_count)
