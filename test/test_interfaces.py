"""The interfaces cross from one process to another over DDS."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from bdnn_interfaces.msg import Finding, Findings
from bdnn_interfaces.srv import InverseDynamics

DISCOVERY = 10.0
SERVER = """
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from bdnn_interfaces.msg import Findings
from bdnn_interfaces.srv import InverseDynamics

rclpy.init()
node = Node("doubler")
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
publisher = node.create_publisher(Findings, "~/findings", latched)
node.create_subscription(Findings, "findings", publisher.publish, latched)

def answer(request, response):
    response.success = True
    response.joint_names = request.joint_names
    response.effort = [2.0 * value for value in request.acceleration]
    return response

node.create_service(InverseDynamics, "~/inverse_dynamics", answer)
while rclpy.ok():  # rclpy.spin, without a timeout, sometimes sleeps through SIGTERM
    rclpy.spin_once(node, timeout_sec=0.2)
"""


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Iterator[Node]:
    """A node of this process beside a server process, alone in a domain of their own."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    domain = 1 + os.getpid() % 100
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    server = subprocess.Popen([sys.executable, "-c", SERVER], env=environment)
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    asker = Node("asker", context=context)
    try:
        yield asker
    finally:
        asker.destroy_node()
        rclpy.try_shutdown(context=context)
        server.terminate()
        server.wait(10)


@pytest.mark.ros
def test_service_and_message_make_the_round_trip(node: Node) -> None:
    executor = SingleThreadedExecutor(context=node.context)
    client = node.create_client(InverseDynamics, "/doubler/inverse_dynamics")
    assert client.wait_for_service(DISCOVERY)
    future = client.call_async(InverseDynamics.Request(joint_names=["a", "b"], acceleration=[1.5, -2.0]))
    executor.add_node(node)
    executor.spin_until_future_complete(future, DISCOVERY)
    answer = future.result()
    assert answer.success
    assert answer.joint_names == ["a", "b"]
    assert list(answer.effort) == [3.0, -4.0]

    finding = Finding(effect="armature", joint="a", parameter_names=["armature"], values=[0.2], share=0.5)
    sent = Findings(verdict="explained", findings=[finding], gain=0.4, advice=["Move joint a faster."])
    returned = rclpy.task.Future(executor=executor)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_publisher(Findings, "findings", latched).publish(sent)
    node.create_subscription(Findings, "/doubler/findings", returned.set_result, latched)
    executor.spin_until_future_complete(returned, DISCOVERY)
    assert returned.result() == sent
