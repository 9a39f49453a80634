"""Publishers whose messages are not received (incompatible QoS or type), and effort commands that never come."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible

from bdnn_ros.online.stream.intake import CommandIntake, Intake

LEAST = 3
"""So many joint states without a command since the last look are no chance."""
NOT_LATCHED = (
    "A publisher of {} is not latched: nothing comes from it. Let it be reliable and transient local, "
    "as robot_state_publisher is, or set the parameter urdf_file."
)
FOREIGN = (
    "{} carries {}, and the node needs {}: nothing comes from it. Remap {} to a topic of that type, or let one "
    "publish it."
)
UNCOMMANDED = (
    "No effort command comes on {}. Remap effort_commands to the topic of the controller's commands, "
    "or let it command."
)


class Hearing:
    """A subscription that detects publishers it cannot receive: those with incompatible QoS or another message type.

    Args:
        node, kind, topic, callback, profile: of the subscription.
        sentence: what to say of such a publisher, with a place for the topic.
        lost: called with events of lost messages, if they matter.
        others: what else the subscription takes.

    Attributes:
        subscription: the subscription itself.
        complaint: which publisher is not heard, and what to do; empty if all are.
    """

    def __init__(
        self,
        node: Node,
        kind: Any,
        topic: str,
        callback: Callable[..., Any],
        profile: QoSProfile,
        sentence: str,
        lost: Callable[[Any], None] | None = None,
        **others: Any,
    ) -> None:
        self.complaint = ""
        self._node = node
        self._name = topic
        self._type = f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}"
        self._profile = profile
        self._sentence = sentence
        self._incompatible = False
        events = SubscriptionEventCallbacks(message_lost=lost, incompatible_qos=self._on_incompatible)
        self.subscription = node.create_subscription(
            kind, topic, callback, profile, event_callbacks=events, **others
        )

    def look(self) -> str:
        """The complaint now. Incompatible QoS is reported until no such publisher is left: no event tells when it goes."""
        topic = self.subscription.topic_name
        publishers = self._node.get_publishers_info_by_topic(topic)
        types = {publisher.topic_type for publisher in publishers}
        self._incompatible &= any(not self._hears(publisher.qos_profile) for publisher in publishers)
        if types and self._type not in types:
            self.complaint = FOREIGN.format(topic, " and ".join(sorted(types)), self._type, self._name)
        else:
            self.complaint = self._sentence.format(topic) if self._incompatible else ""
        return self.complaint

    def _hears(self, offered: QoSProfile) -> bool:
        return bool(qos_check_compatible(offered, self._profile)[0] != QoSCompatibility.ERROR)

    def _on_incompatible(self, event: Any) -> None:
        self._incompatible = True


class Uncommanded:
    """Detects that joint states come but no effort commands."""

    def __init__(self) -> None:
        self._seen: tuple[int, int] | None = None

    def look(self, intake: Intake | None, commands: CommandIntake | None, topic: str) -> str:
        """The complaint about commands missing since the last call; empty if there is none."""
        now = (intake.received if intake else 0, commands.received if commands else 0)
        before, self._seen = self._seen or now, now
        missing = now[0] - before[0] >= LEAST and now[1] == before[1]
        return UNCOMMANDED.format(topic) if missing else ""
