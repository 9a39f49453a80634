"""What the identification node publishes: estimates, findings, diagnostics."""

from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from bdnn_interfaces.msg import DynamicsEstimate, Findings
from bdnn_ros.nodes.conversions import (
    effort_message,
    estimate_message,
    findings_message,
    nothing_yet_message,
)
from bdnn_ros.nodes.diagnostics import Reporter
from bdnn_ros.nodes.error_now import ErrorNow
from bdnn_ros.online.estimate import Instant, Parts
from bdnn_ros.online.serving import Served
from bdnn_ros.online.session import Session

LATCHED = QoSProfile(
    depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE
)


class Publishing:
    """The publishers of the node; `close` destroys them.

    Args:
        node: to create them on.
        session: what they tell of.
    """

    def __init__(self, node: Node, session: Session) -> None:
        self._node = node
        self._session = session
        self._error = ErrorNow()
        self._reporter = Reporter(session, node.get_logger().warning, node.get_fully_qualified_name())
        self._last_stamp = 0
        self._forgotten = session.forgotten
        self._noted: list[str] = []
        self._estimates = self._publisher(DynamicsEstimate, "~/estimate", 10)
        self._efforts = self._publisher(JointState, "~/effort_estimate", 10)
        self._findings = self._publisher(Findings, "~/findings", LATCHED)
        self._diagnostics = self._publisher(DiagnosticArray, "/diagnostics", 10)

    def close(self) -> None:
        """Take the publishers away."""
        for publisher in (self._estimates, self._efforts, self._findings, self._diagnostics):
            self._node.destroy_publisher(publisher)

    def estimate(self) -> None:
        """Publish the estimate at the newest instant, unless it was published already."""
        estimated = self._estimate()
        if estimated is not None:
            served, instant, told = estimated
            self._estimates.publish(estimate_message(served.joints, instant, told, served.number))
            self._efforts.publish(effort_message(served.joints, instant, told))

    def compare(self) -> None:
        """Update the error with the newest instant without publishing."""
        self._estimate()

    def _estimate(self) -> tuple[Served, Instant, Parts] | None:
        """The model's estimate at the newest instant, None if that was handled already; updates the error."""
        error = self._error  # before what is served: of a model that is forgotten meanwhile, it keeps nothing
        served, instant = self._session.served, self._session.instant()
        if served is None or instant is None or instant.stamp == self._last_stamp:
            return None
        self._last_stamp = instant.stamp
        told = served.parts(instant.position, instant.velocity, instant.acceleration)
        error.add(instant.stamp, instant.effort, told.effort)
        return served, instant, told

    def forget(self) -> None:
        """Withdraw the published findings and the error after the model or the findings were reset."""
        if self._forgotten == self._session.forgotten:
            return
        self._forgotten = self._session.forgotten
        self._error, self._noted = ErrorNow(), []
        self._findings.publish(nothing_yet_message(self._now()))

    def tell(
        self, active: bool, trouble: str, message_lost: int, unheard: str = "", refused: str = ""
    ) -> None:
        """Publish the diagnostic status, and the findings of new diagnoses.

        Args:
            active, trouble, message_lost, unheard, refused: as `Reporter.status`.
        """
        self.forget()
        now = self._now()
        array = DiagnosticArray()
        array.header.stamp = now
        status = self._reporter.status(self._error, active, trouble, message_lost, unheard, refused)
        array.status = [status]
        self._diagnostics.publish(array)
        while self._session.findings:
            info = self._session.findings.popleft().info
            if "diagnosis" in info:
                self._findings.publish(findings_message(info["diagnosis"], now))
                self._note(info["diagnosis"])
            elif info.get("unlike"):
                self._node.get_logger().warning(info["error"])
            else:
                self._node.get_logger().info(f"no diagnosis: {info['error']}")

    def _note(self, diagnosis: dict[str, Any]) -> None:
        """Log the notes of a diagnosis, for which the message has no field; not the same twice in a row."""
        if "notes" not in diagnosis:  # a change that was noticed: what the last diagnosis said holds
            return
        noted, self._noted = self._noted, list(diagnosis["notes"])
        for note in self._noted:
            if note not in noted:
                self._node.get_logger().info(note)

    def _now(self) -> Time:
        return self._node.get_clock().now().to_msg()

    def _publisher(self, kind: Any, topic: str, profile: QoSProfile | int) -> Any:
        """A publisher without event handlers: the executor would check each of them between any two joint states."""
        quiet = PublisherEventCallbacks(use_default_callbacks=False)
        return self._node.create_publisher(kind, topic, profile, event_callbacks=quiet)
