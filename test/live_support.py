"""What tests of the live node share: a robot that moves, processes that are seen off, a client that waits."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

DISCOVERY = 10.0
PATIENCE = 40.0
"""Only so long does a test wait for what does not come [s]; a busy machine is slow to do what it does do."""
FIRST_STAMP = 1_000_000_000_000


def real_robot(robot: Robot, seed: int = 1, error: float = 0.1) -> Robot:
    """A robot that differs from its description by some per cent of mass, by armature and friction."""
    generator = np.random.default_rng(seed)
    scale = 1.0 + error * generator.uniform(-1.0, 1.0, (robot.width, 1))
    size = np.abs(robot.gravity(np.full(robot.width, 0.4))).max() / np.arange(1, robot.width + 1)
    return robot.with_inertials(robot.inertials * scale).with_joint_parameters(
        armature=np.full(robot.width, 0.05), viscous=0.05 * size, coulomb=0.05 * size
    )


def motion(
    robot: Robot, duration: float, rate: float, seed: int = 0, noise: float = 0.0, period: float | None = None
) -> Recording:
    """A robot that follows sums of sines exactly, repeated after the period if any; its effort is the
    inverse dynamics, and noise."""
    generator = np.random.default_rng(seed)
    time_ = np.arange(round(duration * rate)) / rate
    frequency = generator.uniform(0.15, 0.9, (4, robot.width)) * 2.0 * np.pi
    if period is not None:
        frequency = np.round(frequency * period / (2.0 * np.pi)) * 2.0 * np.pi / period
    phase = generator.uniform(0.0, 2.0 * np.pi, (4, robot.width))
    amplitude = generator.uniform(0.1, 0.3, (4, robot.width))
    angle = frequency * time_[:, None, None] + phase
    position = (amplitude * np.sin(angle)).sum(axis=1)
    velocity = (amplitude * frequency * np.cos(angle)).sum(axis=1)
    acceleration = -(amplitude * frequency**2 * np.sin(angle)).sum(axis=1)
    effort = robot.inverse_dynamics(position, velocity, acceleration)
    effort = effort + noise * np.abs(effort).max(axis=0) * generator.standard_normal(effort.shape)
    return Recording(time_, robot.joints, position, velocity, effort, urdf=robot.urdf)


def environment(domain: int) -> dict[str, str]:
    """Environment of a process on a ROS domain of its own."""
    return {
        **os.environ,
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "RCUTILS_LOGGING_BUFFERED_STREAM": "0",
        "OMP_NUM_THREADS": "1",
    }


class Process:
    """A process of ours, with its output in a file, that is surely gone at the end."""

    def __init__(self, arguments: list[str], log: Path, domain: int) -> None:
        self.log = log
        with log.open("wb") as output:
            self.process = subprocess.Popen(
                arguments, stdout=output, stderr=subprocess.STDOUT, env=environment(domain)
            )

    @property
    def pid(self) -> int:
        return self.process.pid

    @property
    def output(self) -> str:
        return self.log.read_text(errors="replace")

    def end(self, number: int = signal.SIGINT, patience: float = 20.0) -> int:
        """Send the signal, wait, and return the exit status; kill it where it does not end."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            return self.process.wait(patience)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise AssertionError(f"did not end after signal {number}:\n{self.output}") from None

    def children(self) -> list[int]:
        """Process ids of its children."""
        return children(self.pid)


def children(parent: int) -> list[int]:
    """Process ids of a process's children, whichever of its threads started them."""
    found: set[int] = set()
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{parent}/task").iterdir():
            with contextlib.suppress(OSError):
                found |= {int(pid) for pid in (task / "children").read_text().split()}
    return sorted(found)


@contextlib.contextmanager
def node_process(tmp_path: Path, domain: int, namespace: str = "", **parameters: Any) -> Iterator[Process]:
    """An identification node with these parameters; ended and checked for traces at the end."""
    arguments = [sys.executable, "-m", "bdnn_ros.nodes.identification_node"]
    arguments += ["--ros-args"] if parameters or namespace else []
    arguments += ["-r", f"__ns:={namespace}"] if namespace else []
    for name, value in parameters.items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        arguments += ["-p", f"{name}:={text}"]
    process = Process(arguments, tmp_path / "node.log", domain)
    try:
        yield process
    finally:
        if process.process.poll() is None:
            process.end()
        print(process.output)  # shown where the test fails
        if "Traceback" in process.output:
            raise AssertionError(process.output)


def wait_until(condition: Callable[[], Any], timeout: float = PATIENCE, what: str = "") -> Any:
    """The condition's first true value."""
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.02)
    raise AssertionError(f"timed out after {timeout:g} s waiting for {what or condition}")


class Robotics:
    """A ROS node of the test, spun in the background: publishes, asks services, keeps messages."""

    def __init__(self, domain: int, name: str = "tester") -> None:
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node(name, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.messages: dict[str, list[Any]] = {}
        self._clients: dict[str, Any] = {}
        self._publishers: dict[str, Any] = {}
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def __enter__(self) -> Robotics:
        return self

    def __exit__(self, *error: object) -> None:
        self.executor.shutdown()
        self._thread.join(5.0)
        self.node.destroy_node()
        self.context.try_shutdown()

    def _spin(self) -> None:
        from rclpy.executors import ExternalShutdownException

        with contextlib.suppress(ExternalShutdownException):
            self.executor.spin()

    def call(self, kind: Any, service: str, /, timeout: float = 120.0, **fields: Any) -> Any:
        """Answer of a service; the time-out is for what hangs, a patient trainer on a busy machine may be slow."""
        client = self._clients.get(service)
        if client is None:
            client = self._clients[service] = self.node.create_client(kind, service)
        assert client.wait_for_service(DISCOVERY), f"no service {service}"
        future = client.call_async(kind.Request(**fields))
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        assert future.done() or done.wait(timeout), f"no answer from {service}"
        return future.result()

    def keep(self, kind: Any, topic: str, latched: bool = False, most: int = 5000) -> list[Any]:
        """Messages of a topic, as they come."""
        from rclpy.qos import DurabilityPolicy, QoSProfile

        store: list[Any] = []
        profile = QoSProfile(depth=most)
        if latched:
            profile = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.node.create_subscription(kind, topic, store.append, profile)
        return store

    def publisher(self, kind: Any, topic: str, latched: bool = False, readers: int = 1) -> Any:
        """A publisher that somebody listens to."""
        from rclpy.qos import DurabilityPolicy, QoSProfile

        if topic not in self._publishers:
            profile = QoSProfile(depth=1000)
            if latched:
                profile = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            self._publishers[topic] = self.node.create_publisher(kind, topic, profile)
        publisher = self._publishers[topic]
        wait_until(lambda: publisher.get_subscription_count() >= readers, 20.0, f"a reader of {topic}")
        return publisher

    def stream(
        self,
        recording: Recording,
        topic: str = "joint_states",
        speed: float = 1.0,
        start: int = FIRST_STAMP,
        change: Callable[[int, Any], Any] | None = None,
    ) -> None:
        """Publish a recording as joint states, at its own pace; stamps begin at `start` [ns]."""
        from builtin_interfaces.msg import Time
        from sensor_msgs.msg import JointState

        publisher = self.publisher(JointState, topic)
        began = time.perf_counter()
        for row in range(len(recording)):
            stamp = start + round(float(recording.time[row] - recording.time[0]) * 1e9)
            message = JointState()
            message.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
            message.name = list(recording.joints)
            message.position = recording.position[row].tolist()
            if recording.velocity is not None:
                message.velocity = recording.velocity[row].tolist()
            if recording.effort is not None:
                message.effort = recording.effort[row].tolist()
            if change is not None:
                message = change(row, message)
            due = began + (recording.time[row] - recording.time[0]) / speed
            pause = due - time.perf_counter()
            if pause > 0:
                time.sleep(pause)
            if message is not None:
                publisher.publish(message)


def status(diagnostics: list[Any]) -> dict[str, str]:
    """Keys and values of the newest status of the node; `message` and `level` beside them."""
    told = diagnostics[-1].status[0]
    assert told.name == "bdnn: identification"
    return {
        **{pair.key: pair.value for pair in told.values},
        "message": told.message,
        "level": str(told.level[0]),
    }


def pose(robot: Robot, value: float = 0.3) -> dict[str, list[float]]:
    """A request for inverse dynamics."""
    return {name: [value] * robot.width for name in ("position", "velocity", "acceleration")}


def urdf_file(folder: Path, robot: Robot) -> Path:
    """The robot's description as a file."""
    path = folder / "robot.urdf"
    path.write_text(robot.urdf)
    return path
