"""What should be heard and is not is told of, with what to do."""

from __future__ import annotations

import time
from types import SimpleNamespace

import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

from bdnn_ros.nodes.streams import Streams
from bdnn_ros.nodes.unheard import Uncommanded

pytestmark = pytest.mark.ros


def counted(states, commands):
    return SimpleNamespace(received=states), SimpleNamespace(received=commands), "/arm/effort_commands"


def test_joint_states_without_commands_are_told_of():
    """What the node learned from was nothing, and it said that it was training."""
    uncommanded = Uncommanded()
    assert uncommanded.look(None, None, "/u") == ""
    assert uncommanded.look(*counted(100, 0)).startswith(
        "No effort command comes on /arm/effort_commands. Remap"
    )
    assert uncommanded.look(*counted(200, 1)) == ""
    assert uncommanded.look(*counted(300, 1)) != ""
    assert uncommanded.look(*counted(302, 1)) == ""  # the stream has just ended, or begins
    assert uncommanded.look(*counted(302, 1)) == ""
    assert uncommanded.look(*counted(50, 0)) == ""  # it began anew
    assert Uncommanded().look(*counted(300, 0)) == ""  # they came before the subscription did


@pytest.fixture
def ros():
    """An executor, a node that listens and one that publishes."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    context = rclpy.Context()
    rclpy.init(context=context, domain_id=192)
    nodes = [rclpy.create_node(name, context=context) for name in ("listener", "talker")]
    executor = SingleThreadedExecutor(context=context)
    for node in nodes:
        executor.add_node(node)
    yield executor, *nodes
    executor.shutdown()
    for node in nodes:
        node.destroy_node()
    context.try_shutdown()


def looked(executor, condition, timeout=10.0):
    """Spins until the condition holds."""
    end = time.monotonic() + timeout
    while not condition() and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    return condition()


def test_a_publisher_of_commands_that_is_not_heard_is_told_of(ros):
    executor, listener, talker = ros
    lane = SimpleNamespace(group=lambda: None, holds=lambda _: False, forget=lambda _: None)
    session = SimpleNamespace(intake=None, commands=None, wider=lambda: ())
    streams = Streams(listener, lane, session, lambda names: False, QoSProfile(depth=10), True)
    profile = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    deaf = talker.create_publisher(Float64MultiArray, "effort_commands", profile)

    def told():
        streams.look_around()
        return streams.complaint

    assert looked(executor, told)
    assert (
        told().startswith("A publisher of /effort_commands offers best effort only")
        and "reliability" in told()
    )
    talker.destroy_publisher(deaf)
    assert looked(executor, lambda: not told())
    streams.close()


def test_a_description_that_is_not_latched_is_told_of():
    """The node waited for it without a word."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    from bdnn_ros.nodes.identification import IdentificationNode

    rclpy.init(args=[], domain_id=193)
    node, told = IdentificationNode(), []
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        node.trigger_configure()
        node.trigger_activate()
        node._publishing._diagnostics.publish = lambda array: told.append(array.status[0].message)
        node.create_publisher(String, "robot_description", 10)
        sentence = "waiting for robot_description. A publisher of /robot_description is not latched"
        assert looked(executor, lambda: told and told[-1].startswith(sentence))
    finally:
        node.finish()
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


def test_publishers_of_another_type_are_told_of(ros):
    """Commands that came as joint states were said not to come at all."""
    import rclpy

    executor, listener, _ = ros
    lane = SimpleNamespace(group=lambda: None, holds=lambda _: False, forget=lambda _: None)
    session = SimpleNamespace(intake=None, commands=None, wider=lambda: ())
    streams = Streams(listener, lane, session, lambda names: False, QoSProfile(depth=10), True)
    apart = rclpy.Context()  # one participant has one type of a topic
    rclpy.init(context=apart, domain_id=192)
    talker = rclpy.create_node("foreigner", context=apart)
    foreign = talker.create_publisher(JointState, "effort_commands", 10)

    def told():
        streams.look_around()
        return streams.complaint

    assert looked(executor, told)
    assert told().startswith(
        "/effort_commands carries sensor_msgs/msg/JointState, and the node needs std_msgs/msg/Float64MultiArray: nothing"
    )
    talker.destroy_publisher(foreign)
    assert looked(executor, lambda: not told())
    talker.destroy_node()
    apart.try_shutdown()
    streams.close()
