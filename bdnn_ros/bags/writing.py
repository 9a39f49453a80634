"""Writes a recording as a bag."""

from __future__ import annotations

import heapq
import os
import tempfile
from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path

import numpy as np
from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from bdnn_ros.bags.cdr import encode_float64_multi_array, encode_joint_states, encode_string
from bdnn_ros.bags.joint_states import BLOCK
from bdnn_ros.bags.storage import JOINT_STATE, MULTI_ARRAY, STRING
from bdnn_ros.errors import UsageError
from bdnn_ros.recording import Recording

Message = tuple[int, Connection, bytes]
FOREVER = QosTime(sec=9223372036, nsec=854775807)


def write(
    recording: Recording,
    path: str | Path,
    *,
    joint_states: str = "/joint_states",
    commands: tuple[np.ndarray, np.ndarray] | None = None,
    effort_commands: str = "/effort_commands",
    overwrite: bool = False,
) -> Path:
    """Write a recording and its robot description as a rosbag2 directory (MCAP, zstd) or a plain `.mcap` file.

    The bag appears under its name only when it is complete.

    Args:
        path: the directory to make, or a file name that ends in `.mcap`.
        joint_states: topic of sensor_msgs/JointState; stamps are `epoch + time`, also as log time.
        commands: effort commands: times (K,) [s] on the recording's clock, and values (K, m) [N·m].
        effort_commands: their topic, std_msgs/Float64MultiArray.
        overwrite: replace a bag that is there.

    Returns:
        The path.

    Raises:
        UsageError: there is something at the path, or a stamp does not fit a ROS message.
    """
    path = Path(path)
    refuse_existing(path, overwrite)
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as scratch:
        made = Path(scratch) / "made"  # a directory of its own: the bag's name may be any
        inner = made / path.stem if path.suffix == ".mcap" else made / path.name
        made.mkdir()
        _write_directory(recording, inner, joint_states, commands, effort_commands)
        _take_place(inner / f"{path.stem}.mcap" if path.suffix == ".mcap" else inner, path, Path(scratch))
    return path


def _write_directory(
    recording: Recording,
    path: Path,
    joint_states: str,
    commands: tuple[np.ndarray, np.ndarray] | None,
    effort_commands: str,
) -> None:
    types = get_typestore(Stores.ROS2_JAZZY)
    stamps = _nanoseconds(recording, recording.time)
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:

        def connection(topic: str, kind: str, qos: Qos) -> Connection:
            # rosbags writes the same profiles into the file and into metadata.yaml: were they to differ,
            # readers would silently find no message.
            return writer.add_connection(topic, kind, typestore=types, offered_qos_profiles=[qos])

        if recording.urdf:
            latched = connection("/robot_description", STRING, _qos(1, QosDurability.TRANSIENT_LOCAL))
            writer.write(latched, int(stamps[0]) if len(stamps) else 0, encode_string(recording.urdf))
        states = connection(joint_states, JOINT_STATE, _qos(1000, QosDurability.VOLATILE))
        streams = [_joint_states(recording, stamps, states)]
        if commands is not None:
            times, values = commands
            channel = connection(effort_commands, MULTI_ARRAY, _qos(1000, QosDurability.VOLATILE))
            streams.append(_commands(_nanoseconds(recording, times), values, channel))
        for stamp, channel, data in heapq.merge(*streams, key=itemgetter(0)):
            writer.write(channel, stamp, data)


def _joint_states(recording: Recording, stamps: np.ndarray, connection: Connection) -> Iterator[Message]:
    for start in range(0, len(recording), BLOCK):
        rows = slice(start, start + BLOCK)
        encoded = encode_joint_states(
            recording.joints,
            stamps[rows],
            recording.position[rows],
            None if recording.velocity is None else recording.velocity[rows],
            None if recording.effort is None else recording.effort[rows],
        )
        for stamp, data in zip(stamps[rows].tolist(), encoded, strict=True):
            yield stamp, connection, data


def _commands(stamps: np.ndarray, values: np.ndarray, connection: Connection) -> Iterator[Message]:
    for stamp, row in zip(stamps.tolist(), values, strict=True):
        yield stamp, connection, encode_float64_multi_array(row)


def _nanoseconds(recording: Recording, time: np.ndarray) -> np.ndarray:
    stamps = recording.epoch + np.round(np.asarray(time) * 1e9).astype(np.int64)
    if len(stamps) and (stamps.min() < 0 or stamps.max() >= 2**31 * 10**9):
        raise UsageError(
            f"{recording.name}: stamps from {stamps.min() * 1e-9:.0f} to {stamps.max() * 1e-9:.0f} s "
            "do not fit a ROS message.",
            "Let the recording's epoch be a time from 1970 to 2038.",
        )
    return stamps


def _qos(depth: int, durability: QosDurability) -> Qos:
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=depth,
        reliability=QosReliability.RELIABLE,
        durability=durability,
        deadline=FOREVER,
        lifespan=FOREVER,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=FOREVER,
        avoid_ros_namespace_conventions=False,
    )


def refuse_existing(path: Path, overwrite: bool) -> None:
    """Refuse a path for a bag where something exists that must not be replaced.

    Args:
        overwrite: a bag may be.

    Raises:
        UsageError: there is something else at the path.
    """
    if not path.exists() or (path.is_dir() and not any(path.iterdir())):
        return
    bag = path.suffix == ".mcap" if path.is_file() else (path / "metadata.yaml").is_file()
    if not overwrite or not bag:
        raise UsageError(
            f"{path} exists already{'' if bag else ' and is not a bag'}.",
            "Choose another name, or remove it.",
        )


def _take_place(made: Path, path: Path, scratch: Path) -> None:
    """Move the finished bag to its name; a bag that was there is deleted with the scratch directory."""
    if path.is_dir():
        path.rename(scratch / "old")
    os.replace(made, path)
