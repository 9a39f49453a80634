"""The thread that takes messages and answers past the executor."""

from __future__ import annotations

import contextlib
import threading
import time

import pytest
from live_support import Robotics, wait_until

pytestmark = pytest.mark.ros

DOMAIN = 141


class Offered:
    """A node whose service, subscription and chore are the lane's; its executor spins beside."""

    def __init__(self) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from std_msgs.msg import String
        from std_srvs.srv import SetBool

        from bdnn_ros.nodes.lane import Lane

        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.node = rclpy.create_node("offered", context=self.context)
        self.lane = Lane(self.context)
        self.threads: set[str] = set()
        self.heard: list[str] = []
        self.done: list[float] = []
        self.service = self.node.create_service(
            SetBool, "~/ask", self.answer, callback_group=self.lane.group()
        )
        self.subscription = self.node.create_subscription(
            String, "said", self.hear, 10, callback_group=self.lane.group()
        )
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.spinning = threading.Thread(target=self._spin, daemon=True)
        self.spinning.start()

    def _spin(self) -> None:
        from rclpy.executors import ExternalShutdownException

        with contextlib.suppress(ExternalShutdownException):
            self.executor.spin()

    def answer(self, request, response):
        self.threads.add(threading.current_thread().name)
        if request.data:
            raise RuntimeError("on purpose")
        response.success = True
        return response

    def hear(self, message, info=None) -> None:
        self.threads.add(threading.current_thread().name)
        self.heard.append(message.data)

    def close(self) -> None:
        self.lane.stop()
        self.executor.shutdown()
        self.spinning.join(5.0)
        self.context.try_shutdown()


@pytest.fixture
def offered():
    made = Offered()
    yield made
    made.close()


def test_it_takes_over_from_the_executor_and_lets_go(offered):
    from std_msgs.msg import String
    from std_srvs.srv import SetBool

    with Robotics(DOMAIN) as ros:
        speaker = ros.publisher(String, "said")
        assert ros.call(SetBool, "/offered/ask", data=False).success
        assert "lane" not in offered.threads
        offered.threads.clear()
        offered.lane.answer(offered.service, offered.answer)
        offered.lane.listen(offered.subscription, offered.hear)
        offered.lane.do(lambda: offered.done.append(time.monotonic()), 0.05)
        for k in range(30):
            speaker.publish(String(data=str(k)))
            time.sleep(0.01)
        assert ros.call(SetBool, "/offered/ask", data=False).success
        wait_until(lambda: offered.heard == [str(k) for k in range(30)])
        assert offered.threads == {"lane"}
        assert 3 <= len(offered.done) <= 12
        offered.lane.do(None)
        offered.lane.forget(offered.subscription)
        offered.node.destroy_subscription(offered.subscription)
        count = len(offered.done)
        assert ros.call(SetBool, "/offered/ask", data=False).success
        assert len(offered.done) == count and offered.lane.error is None


def test_an_error_ends_the_node_as_the_executor_would(offered, capfd):
    from std_srvs.srv import SetBool

    offered.lane.answer(offered.service, offered.answer)
    with Robotics(DOMAIN) as ros:
        client = ros.node.create_client(SetBool, "/offered/ask")
        assert client.wait_for_service(10.0)

        def ended() -> bool:
            # DDS may lose a request that follows its discovery at once
            client.call_async(SetBool.Request(data=True))
            time.sleep(0.3)
            return offered.lane.error is not None

        wait_until(ended)
        wait_until(lambda: not offered.context.ok())
    assert "on purpose" in capfd.readouterr().err


def test_the_executor_sleeps_while_messages_come(offered):
    """What the lane has, the executor does not wake for: it would look at its entities twice a message."""
    from std_msgs.msg import String

    offered.lane.listen(offered.subscription, offered.hear)
    woken = 0
    gathered = offered.executor.can_execute

    def counted(entity) -> bool:
        nonlocal woken
        woken += entity is offered.service
        return gathered(entity)

    with Robotics(DOMAIN) as ros:
        speaker = ros.publisher(String, "said")
        time.sleep(0.5)
        offered.executor.can_execute = counted
        offered.executor.wake()
        for _ in range(200):
            time.sleep(0.005)
        silent, woken = woken, 0
        for k in range(200):
            speaker.publish(String(data=str(k)))
            time.sleep(0.005)
        wait_until(lambda: len(offered.heard) == 200)
    assert woken < silent + 100


def test_the_executor_still_takes_events(offered):
    """As of messages lost; here that publishers come and go."""
    from rclpy.event_handler import SubscriptionEventCallbacks
    from std_msgs.msg import String

    counts: list[int] = []
    heard: list[str] = []
    watched = offered.node.create_subscription(
        String,
        "watched",
        lambda message: None,
        10,
        callback_group=offered.lane.group(),
        event_callbacks=SubscriptionEventCallbacks(
            matched=lambda event: counts.append(event.current_count), use_default_callbacks=False
        ),
    )
    offered.lane.listen(watched, lambda message, info: heard.append(message.data))
    offered.node.create_timer(0.1, lambda: None)
    with Robotics(DOMAIN) as ros:
        speaker = ros.publisher(String, "watched")
        wait_until(lambda: counts[-1:] == [1])
        for k in range(300):
            speaker.publish(String(data=str(k)))
            time.sleep(0.005)
        wait_until(lambda: heard[-1:] == ["299"])
    wait_until(lambda: counts[-1:] == [0])
