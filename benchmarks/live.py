"""The live node at 1 kHz, seven joints: losses, latencies, memory, learning; beside a bare rclpy subscriber.

A publisher, the node with its trainer, and a bare node (a subscriber of the same topic and a Trigger service)
run as processes of their own over DDS. Service calls go to both, in turn, from this process.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from _results import keep

ROOT = Path(__file__).resolve().parent.parent
RESULTS = Path(__file__).parent / "results" / "live.json"
CHANGES_RESULTS = RESULTS.with_name("live_changes.json")
CHANGES = {"gripped": 12, "released": 12, "push": 12, "drift": 9, "nothing": 9}
"""Draws of each kind."""
sys.path.insert(0, str(ROOT / "test"))

from live_support import (  # noqa: E402
    Process,
    Robotics,
    children,
    environment,
    motion,
    pose,
    real_robot,
    status,
    wait_until,
)

from bdnn_ros.cli.replay import replayed  # noqa: E402
from bdnn_ros.models import load_model  # noqa: E402
from bdnn_ros.online.learning import Learning  # noqa: E402
from bdnn_ros.recording import Recording  # noqa: E402
from bdnn_ros.robot import Robot  # noqa: E402

NODE = "/identification_node"
DOMAIN = 150
RATE = 1000.0
PERIOD = 60.0
"""The motion repeats after so long [s]; stamps go on."""
START = 1_000_000_000_000


def robots() -> tuple[Robot, Robot]:
    """The description and the real robot: links wrong by up to 20 %, friction and armature left out."""
    described = Robot.bundled("arm7")
    return described, real_robot(described, error=0.2)


def recording(duration: float) -> Recording:
    """The motion that is streamed, with noise; periodic."""
    _, real = robots()
    return motion(real, duration, RATE, noise=0.003, period=PERIOD)


# -- processes -------------------------------------------------------------------------------------


def publish(duration: float) -> None:
    """Child: publishes joint states at 1 kHz by the stamps of the plan, each sent when it is due."""
    import gc

    import rclpy
    from builtin_interfaces.msg import Time
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from sensor_msgs.msg import JointState
    from std_msgs.msg import String

    rclpy.init()
    node = rclpy.create_node("player")
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    description = node.create_publisher(String, "robot_description", latched)
    description.publish(String(data=robots()[0].urdf))
    publisher = node.create_publisher(JointState, "joint_states", QoSProfile(depth=1000))
    plan = recording(min(duration, PERIOD))
    position, velocity, effort = plan.position.tolist(), plan.velocity.tolist(), plan.effort.tolist()
    wait_until(lambda: publisher.get_subscription_count() >= 2, 60.0, "listeners")
    time.sleep(1.0)
    message = JointState(name=list(plan.joints))
    gc.collect()
    gc.freeze()
    gc.disable()
    began = time.perf_counter()
    late = 0.0
    for number in range(round(duration * RATE)):
        row = number % len(position)
        stamp = START + number * round(1e9 / RATE)
        message.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
        message.position, message.velocity, message.effort = position[row], velocity[row], effort[row]
        left = began + number / RATE - time.perf_counter()
        if left > 0:
            time.sleep(left)
        late = max(late, -left)
        publisher.publish(message)
    print(json.dumps({"published": round(duration * RATE), "latest_ms": 1e3 * late}), flush=True)
    time.sleep(3.0)
    node.destroy_node()
    rclpy.try_shutdown()


def bare() -> None:
    """Child: a subscriber that does nothing, a Trigger service, and one that answers inverse dynamics with zeros."""
    import rclpy
    from rclpy.executors import ExternalShutdownException
    from rclpy.qos import QoSProfile
    from sensor_msgs.msg import JointState
    from std_srvs.srv import Trigger

    from bdnn_interfaces.srv import InverseDynamics

    rclpy.init()
    node = rclpy.create_node("bare")
    latencies: list[int] = []
    received = 0

    def take(message: JointState, info: dict[str, int]) -> None:
        nonlocal received
        received += 1
        latencies.append(time.time_ns() - info["source_timestamp"])

    def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = True
        return response

    def zeros(
        request: InverseDynamics.Request, response: InverseDynamics.Response
    ) -> InverseDynamics.Response:
        none = [0.0] * len(request.position)
        response.success, response.joint_names = True, ["joint"] * len(none)
        response.effort = response.effort_std = response.coriolis = response.gravity = none
        response.friction, response.mass_matrix = none, none * len(none)
        return response

    node.create_subscription(JointState, "joint_states", take, QoSProfile(depth=1000))
    node.create_service(Trigger, "~/trigger", answer)
    node.create_service(InverseDynamics, "~/zeros", zeros)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)
    numbers = np.array(latencies[1000:]) * 1e-6
    print(json.dumps({"received": received, "latency_ms": quantiles(numbers)}), flush=True)
    rclpy.try_shutdown()


def measured_node(arguments: list[str]) -> int:
    """Child: the identification node, with a clock around its callback."""
    import rclpy.executors  # noqa: F401

    from bdnn_ros.nodes import identification_node
    from bdnn_ros.nodes.streams import Streams

    durations = np.full(700_000, np.nan)  # touched now, or it would look like memory that grows
    latencies = np.full(700_000, np.nan)
    count = 0
    inner = Streams._take

    def timed(self: Any, message: Any, info: dict[str, int]) -> None:
        nonlocal count
        arrived = time.time_ns()
        began = time.perf_counter_ns()
        inner(self, message, info)
        if count < len(durations):
            durations[count] = (time.perf_counter_ns() - began) * 1e-6
            latencies[count] = (arrived - info["source_timestamp"]) * 1e-6
        count += 1

    Streams._take = timed  # type: ignore[method-assign]
    code = identification_node.main(arguments)
    kept = slice(1000, min(count, len(durations)))
    told = {"callback_ms": quantiles(durations[kept]), "latency_ms": quantiles(latencies[kept])}
    print("MEASURED " + json.dumps(told), flush=True)
    return code


# -- measurements ------------------------------------------------------------------------------------


def quantiles(numbers: np.ndarray) -> dict[str, float]:
    """Median, 99th and highest."""
    if len(numbers) == 0:
        return {}
    return {
        "p50": round(float(np.percentile(numbers, 50)), 4),
        "p99": round(float(np.percentile(numbers, 99)), 4),
        "max": round(float(numbers.max()), 4),
    }


def memory(pid: int) -> float:
    """Resident memory of a process [MiB]; 0 where it is gone."""
    try:
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmRSS"):
                return int(line.split()[1]) / 1024.0
    except OSError:
        pass
    return 0.0


def growth(samples: list[float]) -> float:
    """Growth over the last half, as a share, from its first to its last quarter."""
    half = np.array(samples[len(samples) // 2 :])
    if len(half) < 4:
        return float("nan")
    quarter = max(len(half) // 4, 1)
    return float(half[-quarter:].mean() / half[:quarter].mean() - 1.0)


def _end(process: subprocess.Popen[Any]) -> None:
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(60.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def measure(duration: float, folder: Path) -> dict[str, Any]:
    """One run of all processes."""
    from diagnostic_msgs.msg import DiagnosticArray
    from std_srvs.srv import Trigger

    from bdnn_interfaces.msg import DynamicsEstimate
    from bdnn_interfaces.srv import InverseDynamics

    arm, _ = robots()
    this = str(Path(__file__).resolve())
    node = Process(
        [sys.executable, this, "--child", "node", "--ros-args", "-p", f"model_directory:={folder}"],
        folder / "node.log",
        DOMAIN,
    )
    other = Process([sys.executable, this, "--child", "bare"], folder / "bare.log", DOMAIN)
    player = subprocess.Popen(
        [sys.executable, this, "--child", "publish", "--duration", str(duration)],
        env=environment(DOMAIN),
        stdout=subprocess.PIPE,
        text=True,
    )
    result: dict[str, Any] = {"duration_s": duration, "samples": round(duration * RATE)}
    with contextlib.ExitStack() as ending, Robotics(DOMAIN, "client") as ros:
        for process in (node.process, other.process, player):  # none stays, whatever goes wrong
            ending.callback(_end, process)
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        stamps: list[tuple[float, float]] = []

        def note(message: Any) -> None:
            measured, estimated = np.array(message.effort_measured), np.array(message.effort_estimate)
            time_ = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec - START * 1e-9
            if len(measured):
                errors.append((time_, measured, estimated))
            stamps.append((time.perf_counter(), time_))

        errors: list[tuple[float, np.ndarray, np.ndarray]] = []
        ros.node.create_subscription(DynamicsEstimate, f"{NODE}/estimate", note, 100)
        wait_until(lambda: diagnostics and float(status(diagnostics)["samples_received"]) > 0, 60.0)
        asked = pose(arm)
        memories: dict[str, list[float]] = {"node": [], "trainer": [], "diagnosis": []}
        questions: list[tuple[str, Any, str, dict[str, list[float]]]] = [
            ("inverse_dynamics", InverseDynamics, f"{NODE}/inverse_dynamics", asked),
            ("trigger", Trigger, "/bare/trigger", {}),
            ("zeros", InverseDynamics, "/bare/zeros", asked),
        ]
        round_trips: dict[str, list[float]] = {name: [] for name, *_ in questions}
        while player.poll() is None:
            for _ in range(10):
                questions = [*questions[1:], questions[0]]  # the first after the pause finds all asleep
                for name, kind, service, fields in questions:
                    began = time.perf_counter()
                    ros.call(kind, service, **fields)
                    round_trips[name].append(1e3 * (time.perf_counter() - began))
                time.sleep(0.05)
            memories["node"].append(memory(node.pid))
            for trainer in node.children()[:1]:
                memories["trainer"].append(memory(trainer))
                memories["diagnosis"] += [memory(pid) for pid in children(trainer)]
            if len(errors) > 40_000:
                del errors[20_000:30_000]
        published = json.loads(player.communicate()[0].splitlines()[-1])
        with contextlib.suppress(AssertionError):  # on a machine too busy for it, it stays behind: told below
            wait_until(lambda: status(diagnostics)["samples_buffered"] == "0", 30.0 + 0.2 * duration)
        time.sleep(1.2)
        told = status(diagnostics)
        result |= {
            "publisher": published,
            "received": int(told["samples_received"]),
            "lost": int(told["samples_lost"]),
            "missing": round(duration * RATE) - int(told["samples_received"]),
            "unlearned": int(told["samples_unlearned"]),
            "behind": int(told["samples_buffered"]),
            "rejected": int(told["samples_rejected"]),
            "updates_rejected": int(told["updates_rejected"]),
            "model_version": int(told["model_version"]),
            "estimate_rate_hz": round((len(stamps) - 1) / (stamps[-1][0] - stamps[0][0]), 1),
            "memory_mib": {name: round(values[-1], 1) for name, values in memories.items() if values},
            "memory_highest_mib": {
                name: round(max(values), 1) for name, values in memories.items() if values
            },
            "memory_growth": {
                "node": round(growth(memories["node"]), 4),
                "trainer": round(growth(memories["trainer"]), 4),
            },
            "round_trip_ms": {name: quantiles(np.array(v)) for name, v in round_trips.items()},
            "nmse_after_2_s": nmse(errors, 2.0, min(duration, 32.0)),
        }
    assert node.process.wait() == 0, node.output
    result["bare"] = json.loads(other.output.splitlines()[-1])
    line = next(line for line in node.output.splitlines() if line.startswith("MEASURED"))
    result |= json.loads(line.removeprefix("MEASURED "))
    result["same_as_replay"] = same_as_replay(folder, duration) if duration <= PERIOD else None
    return result


def nmse(errors: list[tuple[float, np.ndarray, np.ndarray]], start: float, end: float) -> float:
    """Squared error of the published estimates over the variance of the measured effort, joints' mean."""
    measured = np.array([m for t, m, _ in errors if start <= t < end])
    estimated = np.array([e for t, _, e in errors if start <= t < end])
    if len(measured) < 10:
        return float("nan")
    return round(float(np.mean(((measured - estimated) ** 2).mean(axis=0) / measured.var(axis=0))), 6)


def same_as_replay(folder: Path, duration: float) -> float:
    """Largest difference between the parameters of the live model and of a replay, relative to their size."""
    arm, _ = robots()
    learning = Learning(arm)
    for _ in replayed(learning, recording(duration)):
        pass
    assert learning.served is not None
    live, again = (m.parameters.vector() for m in (load_model(folder), learning.served.model))
    return float(np.max(np.abs(live - again) / (1e-6 + np.abs(again))))


def both(numbers: dict[str, float]) -> str:
    """The first two: median and 99th, node and trainer."""
    first, second, *_ = numbers.values()
    return f"{first}, {second}"


def table(result: dict[str, Any]) -> str:
    """The numbers beside what they must reach."""
    ours, theirs = result["round_trip_ms"]["inverse_dynamics"], result["round_trip_ms"]["trigger"]
    rows = [
        ("samples missing / sent", f"{result['missing']} / {result['samples']}", "0"),
        ("samples not learned from", result["unlearned"] + result["behind"], "0"),
        (
            "callback p50, p99 ms",
            f"{result['callback_ms']['p50']}, {result['callback_ms']['p99']}",
            "p99 <= 1",
        ),
        ("latency p50, p99 ms", f"{result['latency_ms']['p50']}, {result['latency_ms']['p99']}", ""),
        (
            "latency p50, p99 ms, bare",
            f"{result['bare']['latency_ms']['p50']}, {result['bare']['latency_ms']['p99']}",
            "",
        ),
        ("estimates Hz", result["estimate_rate_hz"], ">= 100"),
        ("memory growth node", f"{result['memory_growth']['node']:.2%}", "< 1 % (10 min)"),
        ("  trainer", f"{result['memory_growth']['trainer']:.2%}", "< 1 % (10 min)"),
        ("memory MiB, node and trainer", both(result["memory_mib"]), ""),
        ("  highest", both(result["memory_highest_mib"]), ""),
        ("  highest of a diagnosis", result["memory_highest_mib"].get("diagnosis", "none"), ""),
        ("inverse dynamics p50, p99 ms", both(ours), ""),
        ("Trigger p50, p99 ms, bare", both(theirs), ""),
        ("answering zeros, bare", both(result["round_trip_ms"]["zeros"]), ""),
        ("ratio p50", f"{ours['p50'] / theirs['p50']:.2f}", "<= 1.5"),
        ("ratio p99", f"{ours['p99'] / theirs['p99']:.2f}", "<= 2"),
        ("nMSE after 2 s", f"{result['nmse_after_2_s']:.4%}", "< 1 %"),
        ("live against replay", result["same_as_replay"], "< 1e-6 (up to 60 s)"),
    ]
    return "\n".join(f"{name:32}{value!s:>24}   {goal}" for name, value, goal in rows)


def changes(quick: bool) -> int:
    """Print what is named of robots that change while they move, and write it."""
    import _live_changes

    counts = dict.fromkeys(_live_changes.KINDS, 3) if quick else CHANGES
    draws = _live_changes.measure(counts, first_seed=4000)
    print(_live_changes.table(draws))
    keep(CHANGES_RESULTS, [asdict(d) for d in draws])
    return 0


def main() -> int:
    """Run, print the table, write the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="30 s instead of 10 minutes")
    parser.add_argument("--duration", type=float, help="seconds of stream")
    parser.add_argument("--changes", action="store_true", help="draws of robots that change, without ROS")
    parser.add_argument("--child", choices=("publish", "bare", "node"), help=argparse.SUPPRESS)
    args, rest = parser.parse_known_args()
    if args.child == "node":
        return measured_node(rest)
    if args.child == "bare":
        bare()
        return 0
    if args.changes:
        return changes(args.quick)
    duration = args.duration or (30.0 if args.quick else 600.0)
    if args.child == "publish":
        publish(duration)
        return 0
    os.environ["ROS_DOMAIN_ID"] = str(DOMAIN)
    with tempfile.TemporaryDirectory() as folder:
        result = measure(duration, Path(folder))
    print(table(result))
    keep(RESULTS, result)
    return 0


if __name__ == "__main__":
    sys.exit(main())
