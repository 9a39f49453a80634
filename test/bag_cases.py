"""Recordings and bags for tests; the bags are written by rosbags alone, not by the code under test."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from bdnn_ros.cli.main import main
from bdnn_ros.recording import Recording

TYPES = get_typestore(Stores.ROS2_JAZZY)
JOINT_STATE = "sensor_msgs/msg/JointState"
MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
STRING = "std_msgs/msg/String"
SECOND = 10**9
EPOCH = 1_700_000_000 * SECOND + 123
Message = tuple[str, str, int, bytes]
"""Topic, type, log time [ns], bytes."""
PENDULUM = """
<robot name="pendulum">
  <link name="base"/>
  <link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="2"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.01"/></inertial></link>
  <joint name="pivot" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="50" velocity="10"/></joint>
</robot>
"""


def motion(
    samples: int = 600,
    rate: float = 100.0,
    joints: Sequence[str] = ("pivot",),
    seed: int = 1,
    urdf: str | None = None,
) -> Recording:
    """A smooth motion of some joints with an effort that means nothing."""
    time = np.round(np.arange(samples) / rate, 9)
    rng = np.random.default_rng(seed)
    speed = rng.uniform(1.0, 3.0, len(joints))
    position = np.sin(speed * time[:, None] + rng.uniform(0.0, 6.0, len(joints)))
    velocity = speed * np.cos(speed * time[:, None])
    effort = 3.0 * position + 0.1 * rng.normal(size=position.shape)
    return Recording(time, tuple(joints), position, velocity, effort, name="motion", urdf=urdf, epoch=EPOCH)


def joint_state(
    names: Sequence[str],
    position: Iterable[float],
    velocity: Iterable[float] = (),
    effort: Iterable[float] = (),
    stamp: int = 0,
    little: bool = True,
    frame: str = "",
) -> bytes:
    """One JointState, serialized by rosbags."""
    kinds = TYPES.types
    header = kinds["std_msgs/msg/Header"](
        stamp=kinds["builtin_interfaces/msg/Time"](sec=stamp // SECOND, nanosec=stamp % SECOND),
        frame_id=frame,
    )
    fields = [np.array(list(values), float) for values in (position, velocity, effort)]
    message = kinds[JOINT_STATE](header, list(names), *fields)
    return bytes(TYPES.serialize_cdr(message, JOINT_STATE, little_endian=little))


def command(values: Iterable[float], labels: Sequence[str] = ()) -> bytes:
    """One Float64MultiArray, serialized by rosbags."""
    kinds = TYPES.types
    dimensions = [kinds["std_msgs/msg/MultiArrayDimension"](label, 1, 1) for label in labels]
    layout = kinds["std_msgs/msg/MultiArrayLayout"](dimensions, 0)
    message = kinds[MULTI_ARRAY](layout, np.array(list(values), float))
    return bytes(TYPES.serialize_cdr(message, MULTI_ARRAY))


def text(value: str) -> bytes:
    """One String, serialized by rosbags."""
    return bytes(TYPES.serialize_cdr(TYPES.types[STRING](value), STRING))


def states(recording: Recording, topic: str = "/joint_states", little: bool = True) -> list[Message]:
    """The JointStates of a recording."""
    stamps = recording.epoch + np.round(recording.time * 1e9).astype(np.int64)
    none: Any = [()] * len(recording)
    rows = zip(
        stamps.tolist(),
        recording.position,
        none if recording.velocity is None else recording.velocity,
        none if recording.effort is None else recording.effort,
        strict=True,
    )
    return [
        (topic, JOINT_STATE, stamp, joint_state(recording.joints, q, v, u, stamp, little))
        for stamp, q, v, u in rows
    ]


def write_bag(
    path: Path,
    messages: Iterable[Message],
    storage: StoragePlugin = StoragePlugin.MCAP,
    compression: CompressionMode = CompressionMode.NONE,
    topics: Sequence[tuple[str, str]] = (),
) -> Path:
    """A rosbag2 directory written by rosbags; `topics` are there even without a message."""
    writer = Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, kind in topics:
            connections[topic] = writer.add_connection(topic, kind, typestore=TYPES)
        for topic, kind, stamp, data in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(
                    topic, kind, typestore=TYPES, offered_qos_profiles=[QOS]
                )
            writer.write(connections[topic], stamp, data)
    return path


def bag_of(path: Path, recording: Recording, urdf: str | None = None) -> Path:
    """A rosbag2 directory (MCAP) of a recording, with its robot description if there is one."""
    messages = states(recording)
    urdf = urdf or recording.urdf
    if urdf:
        messages.insert(0, ("/robot_description", STRING, messages[0][2], text(urdf)))
    return write_bag(path, messages)


QOS = Qos(
    QosHistory.KEEP_LAST,
    10,
    QosReliability.RELIABLE,
    QosDurability.VOLATILE,
    QosTime(0, 0),
    QosTime(0, 0),
    QosLiveliness.AUTOMATIC,
    QosTime(0, 0),
    False,
)


def model_of_pendulum(folder: Path) -> Path:
    """A directory with the model that `identify` makes of the pendulum's motion."""
    bag_of(folder / "bag", motion(urdf=PENDULUM))
    assert main(["identify", str(folder / "bag"), "--out", str(folder / "model")]) == 0
    return folder / "model"
