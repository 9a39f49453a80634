"""The subscriptions to joint states and effort commands; their callbacks copy, and never wait."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from bdnn_ros.online.session import Session

MOST_AT_ONCE = 200
"""Joint states taken in one go when they have piled up."""


class Streams:
    """Creates the subscriptions; `close` takes them away again.

    Args:
        node: to create them on.
        session: that takes the samples.
        choose: asked to fix the joints by the names in the first joint states, until it says that it has.
        profile: quality of service.
        commands: whether effort commands are listened to.

    Attributes:
        lost: messages the middleware says it lost.
    """

    def __init__(
        self,
        node: Node,
        session: Session,
        choose: Callable[[Sequence[str]], bool],
        profile: QoSProfile,
        commands: bool,
    ) -> None:
        self.lost = 0
        self._node = node
        self._session = session
        self._choose = choose
        self._commands: Any = None
        if commands:
            self._commands = node.create_subscription(
                Float64MultiArray, "effort_commands", self._on_command, profile
            )
        lost = SubscriptionEventCallbacks(message_lost=self._on_lost)
        self._states = node.create_subscription(
            JointState, "joint_states", self._on_joint_state, profile, event_callbacks=lost
        )

    def close(self) -> None:
        """Take the subscriptions away."""
        for subscription in (self._states, self._commands):
            if subscription is not None:
                self._node.destroy_subscription(subscription)

    def _on_joint_state(self, message: JointState, info: dict[str, int]) -> None:
        self._take(message, info)
        # what has piled up is taken at once: by way of the executor each would cost ten times as much
        handle = self._states.handle
        with handle:
            for _ in range(MOST_AT_ONCE):
                taken = handle.take_message(JointState, False)
                if taken is None:
                    return
                self._take(*taken)

    def _take(self, message: JointState, info: dict[str, int]) -> None:
        if self._session.intake is None and not self._choose(message.name):
            return
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

    def _on_lost(self, event: Any) -> None:
        self.lost = int(event.total_count)
