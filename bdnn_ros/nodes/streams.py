"""Subscriptions to joint states and effort commands. Their callbacks only copy and never wait."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from bdnn_ros.nodes.lane import Lane
from bdnn_ros.nodes.unheard import Hearing, Uncommanded
from bdnn_ros.online.session import Session

NOT_HEARD = "A publisher of {} offers best effort only: nothing comes from it. Set the parameter reliability to best_effort."


class Streams:
    """The subscriptions of the node; `close` destroys them.

    Joint states go through the executor until the joints are chosen, then through the lane.

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
        complaint: which publisher is not heard, or that no command comes, and what to do; empty if all is well.
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
        self._node = node
        self._lane = lane
        self._session = session
        self._choose = choose
        self._commands: Any = None
        self._hearings: list[Hearing] = []
        if commands:
            self._commands = self._heard(Float64MultiArray, "effort_commands", self._on_command, profile)
        self._states = self._heard(JointState, "joint_states", self._on_joint_state, profile, self._on_lost)
        self._uncommanded = Uncommanded()
        self._joints_are_fixed()

    def look_around(self) -> None:
        """Update `complaint`; restart the stream if further joints of the robot now come (the queue keeps messages meanwhile)."""
        self.complaint = " ".join(filter(None, self._complaints()))
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

    def _heard(
        self,
        kind: Any,
        topic: str,
        callback: Callable[..., Any],
        profile: QoSProfile,
        lost: Callable[[Any], None] | None = None,
    ) -> Any:
        hearing = Hearing(
            self._node, kind, topic, callback, profile, NOT_HEARD, lost, callback_group=self._lane.group()
        )
        self._hearings.append(hearing)
        return hearing.subscription

    def _complaints(self) -> list[str]:
        session, unheard = self._session, [hearing.look() for hearing in self._hearings]
        if self._commands is None:
            return unheard
        silent = self._uncommanded.look(session.intake, session.commands, self._commands.topic_name)
        return [*unheard, "" if any(unheard) else silent]

    def _on_lost(self, event: Any) -> None:
        self.lost = int(event.total_count)
