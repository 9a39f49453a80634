"""How fast bags are read and written, against rosbags and mcap-ros2-support, and what memory reading takes.

Every reader ends with the same arrays (time, position, velocity, effort), every writer with a bag of the same
joint states. mcap-ros2-support takes part where it is installed.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from _results import keep
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from bdnn_ros import bags
from bdnn_ros.recording import Recording

RESULTS = Path(__file__).parent / "results" / "bags.json"
TYPES = get_typestore(Stores.ROS2_JAZZY)
JOINT_STATE = "sensor_msgs/msg/JointState"
JOINTS = tuple(f"panda_joint{k}" for k in range(1, 8))
TARGET = 60_000
"""JointState/s that reading must reach."""


def recording(samples: int) -> Recording:
    """A motion of seven joints at 1 kHz."""
    time = np.arange(samples) * 1e-3
    phase = np.arange(7.0)
    position, velocity = np.sin(time[:, None] + phase), np.cos(time[:, None] + phase)
    return Recording(time, JOINTS, position, velocity, 10.0 * position, epoch=1_700_000_000 * 10**9)


def message(state: Recording, k: int) -> object:
    """Row k as rosbags' JointState."""
    kinds, stamp = TYPES.types, state.epoch + k * 10**6
    clock = kinds["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    header = kinds["std_msgs/msg/Header"](stamp=clock, frame_id="")
    assert state.velocity is not None and state.effort is not None
    return kinds[JOINT_STATE](header, list(JOINTS), state.position[k], state.velocity[k], state.effort[k])


# -- readers -------------------------------------------------------------------------------------------------


def read_here(path: Path) -> np.ndarray:
    """bdnn_ros."""
    return bags.read(path).position


def read_rosbags(path: Path) -> np.ndarray:
    """rosbags, each message deserialized."""
    rows = []
    with Reader(path) as reader:
        for connection, _, data in reader.messages():
            m = TYPES.deserialize_cdr(data, connection.msgtype)
            rows.append(
                (m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec, m.position, m.velocity, m.effort)
            )
    return np.array([row[1] for row in rows])


def read_mcap_ros2(path: Path) -> np.ndarray:
    """mcap-ros2-support, each message decoded."""
    from mcap_ros2.decoder import DecoderFactory

    rows = []
    with (path / f"{path.name}.mcap").open("rb") as file:
        for _, _, _, m in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            rows.append(
                (m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec, m.position, m.velocity, m.effort)
            )
    return np.array([row[1] for row in rows])


# -- writers -------------------------------------------------------------------------------------------------


def write_here(state: Recording, path: Path) -> None:
    """bdnn_ros."""
    bags.write(state, path)


def write_rosbags(state: Recording, path: Path) -> None:
    """rosbags, each message serialized."""
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/joint_states", JOINT_STATE, typestore=TYPES)
        for k in range(len(state)):
            data = TYPES.serialize_cdr(message(state, k), JOINT_STATE)
            writer.write(connection, state.epoch + k * 10**6, data)


def write_mcap_ros2(state: Recording, path: Path) -> None:
    """mcap-ros2-support, each message encoded."""
    from mcap_ros2.writer import Writer as Ros2Writer

    assert state.velocity is not None and state.effort is not None
    path.mkdir()
    definition = TYPES.generate_msgdef(JOINT_STATE, ros_version=2)[0]
    with (path / f"{path.name}.mcap").open("wb") as file:
        writer = Ros2Writer(file)
        schema = writer.register_msgdef(JOINT_STATE, definition)
        for k in range(len(state)):
            stamp = state.epoch + k * 10**6
            clock = {"sec": stamp // 10**9, "nanosec": stamp % 10**9}
            content = {
                "header": {"stamp": clock, "frame_id": ""},
                "name": list(JOINTS),
                "position": state.position[k].tolist(),
                "velocity": state.velocity[k].tolist(),
                "effort": state.effort[k].tolist(),
            }
            writer.write_message("/joint_states", schema, content, stamp, stamp)
        writer.finish()


# -- measurements --------------------------------------------------------------------------------------------


def rate(action: Callable[[], object], samples: int, repeats: int) -> float:
    """JointState/s, the best of some runs."""
    best = np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        best = min(best, time.perf_counter() - start)
    return samples / best


def with_images(path: Path, samples: int, megabytes: int) -> None:
    """A bag in which images make up nearly all of the file."""
    state = recording(samples)
    every = max(samples // max(megabytes, 1), 1)
    rng = np.random.default_rng(0)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        states = writer.add_connection("/joint_states", JOINT_STATE, typestore=TYPES)
        images = writer.add_connection("/camera/image", "sensor_msgs/msg/CompressedImage", typestore=TYPES)
        for k in range(samples):
            stamp = state.epoch + k * 10**6
            writer.write(states, stamp, TYPES.serialize_cdr(message(state, k), JOINT_STATE))
            if k % every == 0 and k // every < megabytes:
                writer.write(images, stamp, rng.bytes(10**6))


def peak_memory(path: Path | None) -> float:
    """Highest resident memory of a process that reads a bag (or only imports), [MB]."""
    code = "import sys\nfrom bdnn_ros import bags\nfor path in sys.argv[1:]: bags.read(path)\n"
    # not ru_maxrss, which a child takes over from its parent
    code += "print(next(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')))"
    command = [sys.executable, "-c", code, *([str(path)] if path else [])]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout) / 1024.0


def memory(folder: Path, samples: int) -> list[dict[str, float]]:
    """Memory that reading takes beyond the imports, for files of growing size with the same joint states."""
    bare = peak_memory(None)
    rows = []
    for megabytes in (0, 100, 400):
        path = folder / f"images{megabytes}"
        with_images(path, samples, megabytes)
        size = (path / f"{path.name}.mcap").stat().st_size / 1e6
        rows.append({"file_mb": round(size, 1), "peak_mb": round(peak_memory(path) - bare, 1)})
    return rows


def installed(module: str) -> bool:
    """Whether a peer is here."""
    from importlib.util import find_spec

    return find_spec(module) is not None


def main() -> int:
    """Measures, prints one table, writes the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--samples", type=int, default=50_000, help="joint states a bag (default: %(default)s)"
    )
    parser.add_argument("--repeats", type=int, default=3, help="best of so many runs (default: %(default)s)")
    args = parser.parse_args()
    state = recording(args.samples)
    readers = {"bdnn_ros": read_here, "rosbags": read_rosbags}
    writers = {"bdnn_ros": write_here, "rosbags": write_rosbags}
    if installed("mcap_ros2"):
        readers["mcap-ros2-support"], writers["mcap-ros2-support"] = read_mcap_ros2, write_mcap_ros2
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bag = bags.write(state, folder / "bag")
        for reader in readers.values():
            np.testing.assert_array_equal(reader(bag), state.position)
        reading = {k: rate(lambda r=r: r(bag), args.samples, args.repeats) for k, r in readers.items()}
        writing = {}
        for key, write in writers.items():
            targets = iter([folder / f"{key}{n}" for n in range(args.repeats)])
            writing[key] = rate(lambda w=write, t=targets: w(state, next(t)), args.samples, args.repeats)
        peaks = memory(folder, 10_000)
    print(f"{args.samples} JointState of 7 joints, MCAP; JointState/s, best of {args.repeats}")
    print(f"{'':20}{'reading':>10}{'writing':>10}")
    for key in readers:
        print(f"{key:20}{reading[key]:10.0f}{writing[key]:10.0f}")
    print(
        "reading 10000 JointState among images:  "
        + ", ".join(f"{p['file_mb']} MB file: {p['peak_mb']} MB" for p in peaks)
    )
    print(f"target: at least {TARGET} read a second: {'met' if reading['bdnn_ros'] >= TARGET else 'MISSED'}")
    results = {"samples": args.samples, "reading_per_s": reading, "writing_per_s": writing, "memory": peaks}
    keep(RESULTS, results)
    return 0


if __name__ == "__main__":
    sys.exit(main())
