"""Bags: what one library writes the other reads, and what is wrong is said."""

from __future__ import annotations

import tracemalloc
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from bag_cases import (
    EPOCH,
    JOINT_STATE,
    MULTI_ARRAY,
    PENDULUM,
    SECOND,
    STRING,
    TYPES,
    Message,
    bag_of,
    command,
    joint_state,
    motion,
    states,
    text,
    write_bag,
)
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionMode, Reader, StoragePlugin
from zstandard import ZstdCompressor, ZstdDecompressor

from bdnn_ros import bags
from bdnn_ros.bags.description import movable_joints
from bdnn_ros.errors import BagError, BdnnError, RecordingError, UsageError
from bdnn_ros.recording import Recording

ARM = ("a", "b", "c")
BOOL = "std_msgs/msg/Bool"
DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def assert_equal(left: Recording, right: Recording) -> None:
    """The same numbers to the last bit."""
    assert left.joints == right.joints
    assert left.epoch == right.epoch
    np.testing.assert_allclose(left.time, right.time, rtol=0.0, atol=1e-12)
    for field in ("position", "velocity", "effort"):
        np.testing.assert_array_equal(getattr(left, field), getattr(right, field))


@pytest.mark.parametrize("name", ["bag", "bag.mcap"])
def test_what_is_written_reads_back(tmp_path: Path, name: str) -> None:
    recording = motion(joints=ARM, urdf="<robot name='r'/>")
    path = bags.write(recording, tmp_path / name)
    again = bags.read(path)
    assert_equal(again, recording)
    assert again.urdf == recording.urdf
    assert again.notes == ()
    assert path.is_file() == name.endswith(".mcap")


@pytest.mark.parametrize("field", ["velocity", "effort"])
def test_a_field_that_was_not_measured_stays_away(tmp_path: Path, field: str) -> None:
    recording = replace(motion(joints=ARM), **{field: None})
    assert_equal(bags.read(bags.write(recording, tmp_path / "bag")), recording)


def test_rosbags_reads_what_is_written(tmp_path: Path) -> None:
    recording = motion(joints=ARM, urdf="<robot/>")
    times = recording.time[::7] + 0.0011
    bags.write(recording, tmp_path / "bag", commands=(times, np.tile(times[:, None], (1, 3))))
    with Reader(tmp_path / "bag") as reader:
        found = [
            (c.topic, stamp, TYPES.deserialize_cdr(data, c.msgtype)) for c, stamp, data in reader.messages()
        ]
        kinds = {c.topic: c.msgtype for c in reader.connections}
    assert kinds == {
        "/joint_states": JOINT_STATE,
        "/robot_description": STRING,
        "/effort_commands": MULTI_ARRAY,
    }
    assert [stamp for _, stamp, _ in found] == sorted(stamp for _, stamp, _ in found)
    described = [message.data for topic, _, message in found if topic == "/robot_description"]
    assert described == ["<robot/>"]
    measured = [(stamp, message) for topic, stamp, message in found if topic == "/joint_states"]
    assert len(measured) == len(recording)
    for k, (stamp, message) in enumerate(measured):
        assert tuple(message.name) == ARM
        assert message.header.stamp.sec * SECOND + message.header.stamp.nanosec == stamp
        np.testing.assert_array_equal(message.position, recording.position[k])
        np.testing.assert_array_equal(message.velocity, recording.velocity[k])
        np.testing.assert_array_equal(message.effort, recording.effort[k])
    commanded = [
        (stamp - EPOCH, message.data[2]) for topic, stamp, message in found if topic == "/effort_commands"
    ]
    np.testing.assert_allclose(commanded, np.stack([np.round(times * 1e9), times], axis=1))


def test_metadata_and_file_agree(tmp_path: Path) -> None:
    path = bags.write(motion(urdf="<robot/>"), tmp_path / "bag")
    information = yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (information["version"], information["storage_identifier"]) == (9, "mcap")
    assert information["relative_file_paths"] == ["bag.mcap"]
    promised = {
        t["topic_metadata"]["name"]: (t["topic_metadata"]["offered_qos_profiles"], t["message_count"])
        for t in information["topics_with_message_count"]
    }
    with (path / "bag.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and summary.statistics is not None
    for key, channel in summary.channels.items():
        profiles = yaml.safe_load(channel.metadata["offered_qos_profiles"])
        assert (profiles, summary.statistics.channel_message_counts[key]) == promised[channel.topic]
    assert promised["/robot_description"][0][0]["durability"] == "transient_local"
    assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("compression", list(CompressionMode))
def test_reads_what_rosbags_writes(
    tmp_path: Path, storage: StoragePlugin, compression: CompressionMode
) -> None:
    if storage is StoragePlugin.SQLITE3 and compression is CompressionMode.STORAGE:
        pytest.skip("sqlite3 has no compression of its own")
    recording = motion(joints=ARM)
    path = write_bag(tmp_path / "bag", states(recording), storage, compression)
    assert_equal(bags.read(path), recording)
    assert bags.topics(path) == [bags.Topic("/joint_states", JOINT_STATE, len(recording))]


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_compressed_messages_are_read_without_metadata(tmp_path: Path, storage: StoragePlugin) -> None:
    """Only metadata.yaml says so, which nobody reads of a file that is passed by itself: it was called damaged."""
    recording = motion(joints=ARM)
    path = write_bag(tmp_path / "bag", states(recording), storage, CompressionMode.MESSAGE)
    (file,) = (file for file in path.iterdir() if file.suffix != ".yaml")
    assert_equal(bags.read(file), recording)
    (path / "metadata.yaml").unlink()
    assert_equal(bags.read(path), recording)


def test_reads_a_bare_database(tmp_path: Path) -> None:
    recording = motion(joints=ARM)
    path = write_bag(tmp_path / "bag", states(recording), StoragePlugin.SQLITE3)
    assert_equal(bags.read(path / "bag.db3"), recording)


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("indexed", [True, False])
def test_reads_what_the_mcap_library_writes(
    tmp_path: Path, compression: CompressionType, indexed: bool
) -> None:
    recording = motion(joints=ARM, samples=3000)
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file, compression=compression, chunk_size=100_000, use_statistics=indexed)
        writer.start(profile="ros2")
        schema = writer.register_schema(
            JOINT_STATE, "ros2msg", TYPES.generate_msgdef(JOINT_STATE)[0].encode()
        )
        channel = writer.register_channel("/joint_states", "cdr", schema)
        for _, _, stamp, data in states(recording):
            writer.add_message(channel, stamp, data, stamp)
        writer.finish()
    assert_equal(bags.read(path), recording)


WITHOUT_MESSAGES = [IndexType.NONE, IndexType.ALL & ~IndexType.MESSAGE]
"""Indexes of an MCAP file that do not say where the messages are."""


def write_unindexed(
    path: Path,
    messages: Sequence[Message],
    indexes: IndexType,
    *,
    counted: bool = True,
    chunked: bool = True,
) -> Path:
    """An MCAP file with these indexes."""
    with path.open("wb") as file:
        writer = McapWriter(
            file,
            chunk_size=100_000,
            index_types=indexes,
            use_statistics=counted,
            use_chunking=chunked,
        )
        writer.start(profile="ros2")
        channels: dict[str, int] = {}
        for topic, kind, stamp, data in messages:
            if topic not in channels:
                schema = writer.register_schema(kind, "ros2msg", TYPES.generate_msgdef(kind)[0].encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic], stamp, data, stamp)
        writer.finish()
    return path


@pytest.mark.parametrize("counted", [True, False])
@pytest.mark.parametrize("indexes", WITHOUT_MESSAGES)
def test_messages_that_no_index_lists_are_read(tmp_path: Path, indexes: IndexType, counted: bool) -> None:
    """The messages were called ones that name no joint: chunks without an index were passed over."""
    recording = motion(joints=ARM, samples=3000)
    path = write_unindexed(tmp_path / "a.mcap", states(recording), indexes, counted=counted)
    assert_equal(bags.read(path), recording)
    assert bags.topics(path) == [bags.Topic("/joint_states", JOINT_STATE, 3000)]


@pytest.mark.parametrize("counted", [True, False])
@pytest.mark.parametrize("indexes", WITHOUT_MESSAGES)
def test_topics_that_no_index_lists_are_told(tmp_path: Path, indexes: IndexType, counted: bool) -> None:
    """Those whose messages nobody reads were not among the topics."""
    recording = motion(joints=ARM, samples=3000)
    chatter = [("/chatter", BOOL, stamp, b"\0\1\0\0\1") for _, _, stamp, _ in states(recording)[::2]]
    messages = sorted([*states(recording), *chatter], key=lambda message: message[2])
    path = write_unindexed(tmp_path / "a.mcap", messages, indexes, counted=counted)
    assert_equal(bags.read(path), recording)
    assert bags.topics(path) == [
        bags.Topic("/chatter", BOOL, 1500),
        bags.Topic("/joint_states", JOINT_STATE, 3000),
    ]


@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("indexes", [IndexType.ALL, *WITHOUT_MESSAGES])
def test_messages_need_not_be_in_the_order_of_their_log_times(
    tmp_path: Path, indexes: IndexType, chunked: bool
) -> None:
    """Those of two topics overtake each other: files without chunks, as rosbag2's fastwrite makes them, were called damaged."""
    recording = motion(joints=ARM)
    sent = [
        ("/u", MULTI_ARRAY, message[2] - 1000, command(row))
        for message, row in zip(states(recording), 2.0 * recording.require_effort(), strict=True)
    ]
    messages = [message for pair in zip(states(recording), sent, strict=True) for message in pair]
    path = write_unindexed(tmp_path / "a.mcap", messages, indexes, chunked=chunked)
    assert_equal(bags.read(path), recording)
    twice = replace(recording, effort=2.0 * recording.require_effort())
    assert_equal(bags.read(path, bags.Selection(effort="command")), twice)


@pytest.mark.parametrize("indexes", WITHOUT_MESSAGES)
def test_a_directory_is_read_as_its_file_is(tmp_path: Path, indexes: IndexType) -> None:
    """In one whose metadata.yaml speaks of compressed messages, those that no index lists were passed over."""
    recording = motion(joints=ARM, samples=3000)
    path = write_bag(tmp_path / "bag", states(recording), StoragePlugin.MCAP, CompressionMode.MESSAGE)
    compress = ZstdCompressor().compress
    messages = [(topic, kind, stamp, compress(data)) for topic, kind, stamp, data in states(recording)]
    file = write_unindexed(path / "bag.mcap", messages, indexes)
    assert_equal(bags.read(file), recording)
    assert_equal(bags.read(path), recording)


@pytest.mark.parametrize("profile", ["ros2", ""])
@pytest.mark.parametrize("encoding", ["ros2msg", "jsonschema", "protobuf"])
def test_reads_what_is_beside_messages_of_others(tmp_path: Path, profile: str, encoding: str) -> None:
    """As tools write that show more than ROS: it was refused as damaged."""
    recording = motion(joints=ARM)
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile=profile)
        other = writer.register_channel(
            "/log", "json", writer.register_schema("Log", encoding, b"string text")
        )
        schema = writer.register_schema(
            JOINT_STATE, "ros2msg", TYPES.generate_msgdef(JOINT_STATE)[0].encode()
        )
        channel = writer.register_channel("/joint_states", "cdr", schema)
        for _, _, stamp, data in states(recording):
            writer.add_message(other, stamp, b"{}", stamp)
            writer.add_message(channel, stamp, data, stamp)
        writer.finish()
    assert_equal(bags.read(path), recording)


def test_reads_big_endian(tmp_path: Path) -> None:
    recording = motion(joints=ARM)
    assert_equal(bags.read(write_bag(tmp_path / "bag", states(recording, little=False))), recording)


JOINTS_FROM_THE_TIP = (
    ("grip", "fixed", "hand", "pad"),
    ("c", "revolute", "forearm", "hand"),
    ("look", "revolute", "base", "head"),
    ("b", "continuous", "arm", "forearm"),
    ("a", "revolute", "base", "arm"),
)


def test_joints_come_from_the_base_outwards_whatever_their_order_in_the_description(tmp_path: Path) -> None:
    """One limb after another: SO-101's description, for one, begins at the gripper."""
    rows = (
        f'<joint name="{n}" type="{t}"><parent link="{p}"/><child link="{c}"/></joint>'
        for n, t, p, c in JOINTS_FROM_THE_TIP
    )
    urdf = f'<robot name="arm">{"".join(rows)}</robot>'
    assert movable_joints(urdf) == ("look", "a", "b", "c")
    assert movable_joints("<robot/>") == movable_joints("<robot") == movable_joints(None) == ()
    recording = replace(motion(joints=ARM).select(["c", "a", "b"]), urdf=urdf)
    bags.write(recording, tmp_path / "bag")
    assert bags.read(tmp_path / "bag").joints == ("a", "b", "c")


def test_joints_may_change_their_order(tmp_path: Path) -> None:
    recording = motion(joints=ARM)
    order = ["c", "a", "b"]
    shuffled = states(recording.select(order))
    messages = [b if k % 3 else a for k, (a, b) in enumerate(zip(states(recording), shuffled, strict=True))]
    assert_equal(bags.read(write_bag(tmp_path / "bag", messages)), recording)
    assert_equal(bags.read(tmp_path / "bag", bags.Selection(joints=order)), recording.select(order))


def test_joints_may_join_on_the_way(tmp_path: Path) -> None:
    recording = motion(joints=(*ARM, "finger"))
    arm = recording.select(ARM)
    messages = [*states(arm)[:300], *states(recording)[300:]]
    again = bags.read(write_bag(tmp_path / "bag", messages), bags.Selection(joints=ARM))
    assert_equal(again, arm)
    assert "finger" in again.notes[0]


def test_two_publishers_of_different_joints(tmp_path: Path) -> None:
    arm, gripper = motion(joints=ARM), motion(joints=("left", "right"), samples=550, seed=4)
    gripper = replace(gripper, time=gripper.time + 0.003)
    messages = sorted([*states(arm), *states(gripper)], key=lambda message: message[2])
    path = write_bag(tmp_path / "bag", messages)
    again = bags.read(path)
    assert_equal(again, arm)
    assert "550 of 1150 joint states hold other joints" in again.notes[1]
    np.testing.assert_array_equal(
        bags.read(path, bags.Selection(joints=["right"])).position, gripper.position[:, 1:]
    )
    np.testing.assert_array_equal(
        bags.read(path, bags.Selection(robot_joints=["x", "right", "left"])).joints, ["right", "left"]
    )


def test_two_publishers_of_the_same_joints(tmp_path: Path) -> None:
    arm = motion(joints=ARM)
    late = replace(motion(joints=(*ARM, "finger"), samples=500), epoch=EPOCH - 5_000_000)
    messages = [message for pair in zip(states(arm), states(late), strict=False) for message in pair]
    messages += states(arm)[500:]
    again = bags.read(write_bag(tmp_path / "bag", messages), bags.Selection(joints=ARM))
    assert_equal(again, arm)


def test_messages_that_change_their_joints_on_the_way_are_of_one_publisher(tmp_path: Path) -> None:
    """As where a controller is started; a stamp that comes twice or late, at the change or elsewhere, makes no second."""
    arm, rng = motion(joints=ARM), np.random.default_rng(0)
    more = replace(
        arm,
        joints=(*ARM, "finger"),
        **{
            field: np.column_stack([getattr(arm, field), np.ones(len(arm))])
            for field in ("position", "velocity", "effort")
        },
    )
    for name, strays in (("none", {}), ("twice", {50: 49}), ("late", {301: 297}), ("change", {300: 299})):
        stamps = EPOCH + np.round((arm.time + rng.uniform(0.0, 0.002, len(arm))) * 1e9).astype(np.int64)
        for row, of in strays.items():
            stamps[row] = stamps[of]
        messages = [
            (topic, kind, log, joint_state(one.joints, one.position[k], (), one.require_effort()[k], stamp))
            for k, ((topic, kind, log, _), stamp) in enumerate(zip(states(arm), stamps.tolist(), strict=True))
            for one in [arm if k < 300 else more]
        ]
        again = bags.read(write_bag(tmp_path / name, messages), bags.Selection(joints=ARM), drop_invalid=True)
        assert len(again) == len(arm) - len(strays), name


def test_a_second_publisher_that_is_slow_is_known_by_stamps_between_those_of_the_first(
    tmp_path: Path,
) -> None:
    arm = motion(joints=ARM)
    other = replace(motion(joints=(*ARM, "finger"), samples=60, rate=10.0), epoch=EPOCH + 3_000_000)
    messages = sorted([*states(arm), *states(other)], key=lambda message: message[2])
    assert_equal(bags.read(write_bag(tmp_path / "bag", messages), bags.Selection(joints=ARM)), arm)


def test_the_description_chooses_the_joints(tmp_path: Path) -> None:
    recording = motion(joints=("wheel", "pivot"), urdf=PENDULUM)
    again = bags.read(bag_of(tmp_path / "bag", recording))
    assert again.joints == ("pivot",)
    assert again.urdf == PENDULUM
    assert "wheel" in again.notes[0]


def test_rename_comes_before_the_choice(tmp_path: Path) -> None:
    recording = motion(joints=("old_pivot", "old_x"), urdf=PENDULUM)
    again = bags.read(bag_of(tmp_path / "bag", recording), bags.Selection(rename=["s/old_//"]))
    assert again.joints == ("pivot",)
    np.testing.assert_array_equal(again.position[:, 0], recording.position[:, 0])


def test_a_namespaced_description_is_found(tmp_path: Path) -> None:
    messages = states(motion(), topic="/left/joint_states")
    messages.append(("/left/robot_description", STRING, messages[-1][2], text(PENDULUM)))
    path = write_bag(tmp_path / "bag", messages)
    assert bags.read(path, bags.Selection(joint_states="/left/joint_states")).urdf == PENDULUM


def test_the_description_beside_the_joint_states_is_theirs_whatever_was_logged_last(tmp_path: Path) -> None:
    messages = states(motion(), topic="/left/joint_states")
    first, last = messages[0][2], messages[-1][2]
    own, other = text(PENDULUM), text("<robot name='another'/>")
    for name, own_at, other_at in (("own", last, first), ("other", first, last)):
        both = [
            ("/left/robot_description", STRING, own_at, own),
            ("/robot_description", STRING, other_at, other),
        ]
        path = write_bag(tmp_path / name, sorted([*messages, *both], key=lambda message: message[2]))
        assert bags.read(path, bags.Selection(joint_states="/left/joint_states")).urdf == PENDULUM
    empty = ("/left/robot_description", STRING, first, text(""))
    path = write_bag(tmp_path / "empty", [*messages, empty, both[1]])
    assert (
        bags.read(path, bags.Selection(joint_states="/left/joint_states")).urdf == "<robot name='another'/>"
    )


def test_stamps_of_the_recorder_stand_in_for_none(tmp_path: Path) -> None:
    stamped = motion(joints=ARM)
    messages = [
        (topic, kind, log, joint_state(ARM, q))
        for (topic, kind, log, _), q in zip(states(stamped), stamped.position, strict=True)
    ]
    again = bags.read(write_bag(tmp_path / "bag", messages))
    np.testing.assert_allclose(again.time, stamped.time, atol=1e-12)
    assert again.epoch == EPOCH
    assert "header stamps are zero" in again.notes[0]


def test_messages_without_a_stamp_among_others_are_left_out(tmp_path: Path) -> None:
    recording = motion(joints=ARM)
    messages = states(recording)
    for k in (0, 1, 2, 300):
        unstamped = joint_state(ARM, recording.position[k], recording.velocity[k], recording.effort[k], 0)
        messages[k] = (*messages[k][:3], unstamped)
    again = bags.read(write_bag(tmp_path / "bag", messages))
    np.testing.assert_array_equal(again.effort, np.delete(recording.effort, [0, 1, 2, 300], axis=0))
    assert "4 of 600 header stamps are zero" in again.notes[0]


def test_a_clock_may_start_at_zero(tmp_path: Path) -> None:
    simulated = replace(motion(joints=ARM), epoch=0)
    assert_equal(bags.read(write_bag(tmp_path / "bag", states(simulated))), simulated)


def test_header_stamps_count_not_the_recorders(tmp_path: Path) -> None:
    recording = motion(joints=ARM)
    messages = [(t, k, log + 10**7 * (n % 3), data) for n, (t, k, log, data) in enumerate(states(recording))]
    assert_equal(
        bags.read(write_bag(tmp_path / "bag", messages), drop_invalid=True),
        bags.read(tmp_path / "bag", drop_invalid=True),
    )
    in_order = [(t, k, log + 10**9, data) for t, k, log, data in states(recording)]
    assert_equal(bags.read(write_bag(tmp_path / "late", in_order)), recording)


@pytest.mark.parametrize("value", [np.nan, 0.0])
def test_velocity_that_nobody_reports_is_absent(tmp_path: Path, value: float) -> None:
    recording = motion(joints=ARM)
    messages = [
        (t, k, log, joint_state(ARM, q, np.full(3, value), u, log))
        for (t, k, log, _), q, u in zip(states(recording), recording.position, recording.effort, strict=True)
    ]
    path = write_bag(tmp_path / "bag", messages)
    for again in (bags.read(path), bags.read_every(path).motion):
        assert again.velocity is None
        assert "no velocity is reported for a, b, c" in again.notes[0]


@pytest.mark.parametrize("stray", [np.nan, 1e300])
def test_a_position_that_is_none_does_not_hide_that_nobody_reports_velocity(
    tmp_path: Path, stray: float
) -> None:
    recording = motion(joints=ARM)
    position = recording.position.copy()
    position[70] = stray
    messages = [
        (t, k, log, joint_state(ARM, q, np.zeros(3), u, log))
        for (t, k, log, _), q, u in zip(states(recording), position, recording.require_effort(), strict=True)
    ]
    path = write_bag(tmp_path / "bag", messages)
    again = bags.read(path, drop_invalid=True)
    assert len(again) == 599 and again.velocity is None
    assert bags.read_every(path).motion.velocity is None


@pytest.mark.parametrize("value", [np.nan, 0.0])
def test_velocity_that_one_joint_does_not_report_is_derived_for_it_alone(
    tmp_path: Path, value: float
) -> None:
    """A gripper may report none; what the arm reports beside it counts all the same."""
    recording = motion(joints=ARM)
    assert recording.velocity is not None
    silent = recording.velocity.copy()
    silent[:, 1] = value
    wrapped = recording.position.copy()  # within a turn, whose end the joint passes
    wrapped[:, 1] = np.remainder(wrapped[:, 1] - wrapped[300, 1], 2.0 * np.pi) - np.pi
    messages = [
        (t, k, log, joint_state(ARM, q, v, u, log))
        for (t, k, log, _), q, v, u in zip(states(recording), wrapped, silent, recording.effort, strict=True)
    ]
    messages[400] = (
        *messages[400][:3],
        joint_state(ARM, wrapped[399], silent[399], recording.effort[399], messages[400][2]),
    )
    path = write_bag(tmp_path / "bag", messages)
    for again in (bags.read(path), bags.read_every(path).motion):
        assert again.velocity is not None
        others, slope = np.arange(600) != 400, np.gradient(recording.position[:, 1], recording.time)
        np.testing.assert_array_equal(again.velocity[others][:, ::2], recording.velocity[others][:, ::2])
        np.testing.assert_allclose(again.velocity[others, 1], slope[others], atol=0.03)
        np.testing.assert_array_equal(again.velocity[400], again.velocity[399])  # a repeat stays one
        assert "no velocity is reported for b; it is derived from the position" in again.notes[0]


def test_velocity_of_some_messages_only_is_left_out(tmp_path: Path) -> None:
    recording = motion(joints=ARM)
    without = states(replace(recording, velocity=None))
    again = bags.read(write_bag(tmp_path / "bag", [*without[:7], *states(recording)[7:]]))
    assert_equal(again, replace(recording, velocity=None))
    assert "no velocity is reported for 7 samples" in again.notes[0]


def test_effort_of_zero_throughout_is_no_measurement(tmp_path: Path) -> None:
    recording = motion(joints=ARM)
    again = bags.read(write_bag(tmp_path / "bag", states(replace(recording, effort=np.zeros((600, 3))))))
    assert again.effort is None
    assert "every effort is zero" in again.notes[0]


def test_commands_of_zero_throughout_are_efforts(tmp_path: Path) -> None:
    """A controller that adds gravity is asked for nothing else; none was said to be recorded."""
    recording = replace(motion(joints=ARM), effort=np.zeros((600, 3)))
    path = bags.write(recording, tmp_path / "bag", commands=(recording.time, np.zeros((600, 3))))
    assert_equal(bags.read(path, bags.Selection(effort="command")), recording)
    assert not bags.read_every(path, bags.Selection(effort="command")).effort.any()


def test_effort_that_one_joint_does_not_report_is_named(tmp_path: Path) -> None:
    recording = motion(joints=ARM)
    messages = [
        (t, k, log, joint_state(ARM, q, (), (1.0, np.nan, 2.0), log))
        for (t, k, log, _), q in zip(states(recording), recording.position, strict=True)
    ]
    path = write_bag(tmp_path / "bag", messages)
    again = bags.read(path)
    assert "no effort is reported for b" in again.notes[0]
    np.testing.assert_array_equal(again.effort, np.tile([1.0, 0.0, 2.0], (600, 1)))
    notes = bags.read(path, bags.Selection(joints=["a", "c"])).notes
    assert not any("no effort is reported" in note for note in notes)


def test_bad_samples_are_refused_or_dropped(tmp_path: Path) -> None:
    recording = motion(joints=ARM)
    messages = states(recording)
    bad = joint_state(ARM, (0.0, np.nan, 0.0), (0, 0, 0), (0, 0, 0), messages[10][2])
    path = write_bag(tmp_path / "bag", [*messages[:10], (*messages[10][:3], bad), *messages[11:]])
    with pytest.raises(RecordingError, match=r"position of b is not finite at 0.100 s"):
        bags.read(path)
    assert len(bags.read(path, drop_invalid=True)) == len(recording) - 1
    backwards = [
        (t, k, EPOCH + n, data) for n, (t, k, _, data) in enumerate([*messages[300:], *messages[:300]])
    ]
    path = write_bag(tmp_path / "back", backwards)
    with pytest.raises(RecordingError, match="do not increase"):
        bags.read(path)
    again = bags.read(path, drop_invalid=True)
    assert again.segments() == [slice(0, 300), slice(300, 600)]
    assert "clock jumps back once" in again.notes[0]
    np.testing.assert_array_equal(again.position, np.roll(recording.position, 300, axis=0))


def test_repeated_stamps_are_left_out(tmp_path: Path) -> None:
    messages = states(motion(joints=ARM))
    again = bags.read(write_bag(tmp_path / "bag", [m for message in messages for m in (message, message)]))
    assert_equal(again, motion(joints=ARM))
    assert "repeat the stamp" in again.notes[0]


def test_messages_that_make_no_sense_are_left_out(tmp_path: Path) -> None:
    recording = motion(joints=ARM)
    good = states(recording)
    stamp = good[0][2]
    senseless = [
        joint_state(ARM, (1.0, 2.0), stamp=stamp),
        joint_state((), (1.0, 2.0), stamp=stamp),
        joint_state(ARM, (), (), (1.0, 2.0, 3.0), stamp=stamp),
        joint_state(("a", "a", "b"), (1.0, 2.0, 3.0), stamp=stamp),
        good[0][3][:40],
        b"\x00\x07" + good[0][3][2:],
    ]
    messages = [*(("/joint_states", JOINT_STATE, stamp, data) for data in senseless), *good]
    again = bags.read(write_bag(tmp_path / "bag", messages))
    assert_equal(again, recording)
    assert len(again.notes) == 2
    only = [("/joint_states", JOINT_STATE, stamp + k, data) for k, data in enumerate(senseless)]
    with pytest.raises(BagError, match="can be decoded"):
        bags.read(write_bag(tmp_path / "none", only))


def test_commands_are_held_until_the_next(tmp_path: Path) -> None:
    recording = motion(samples=50, joints=ARM)
    sent = np.array([0.095, 0.2, 0.3051])
    values = np.arange(9.0).reshape(3, 3)
    path = bags.write(replace(recording, effort=None), tmp_path / "bag", commands=(sent, values))
    again = bags.read(path, bags.Selection(effort="command"))
    expected = [values[0]] * 10 + [values[1]] * 11 + [values[2]] * 19
    np.testing.assert_array_equal(again.effort, expected)
    np.testing.assert_allclose(again.time[0] + again.epoch * 1e-9, EPOCH * 1e-9 + 0.1, rtol=0, atol=1e-6)
    assert "in the order a, b, c" in again.notes[0]
    assert "10 samples before the first command" in again.notes[1]
    turned = bags.read(path, bags.Selection(effort="command", joints=["c", "b", "a"]))
    np.testing.assert_array_equal(turned.effort, expected)
    fewer = bags.read(path, bags.Selection(effort="command", joints=["c", "a"]))
    np.testing.assert_array_equal(fewer.effort, np.array(expected)[:, [2, 0]])
    short = bags.write(recording, tmp_path / "short", commands=(sent, values[:, :2]))
    with pytest.raises(RecordingError, match="have 2 values"):
        bags.read(short, bags.Selection(effort="command"))


def test_commands_stand_for_the_described_joints_wherever_the_description_came_from(tmp_path: Path) -> None:
    """Drivers list their joints by the alphabet, commands those of the robot from its base outwards."""
    chain = zip(ARM, ("base", *ARM), ARM, strict=False)
    rows = (
        f'<joint name="{n}" type="revolute"><parent link="{p}"/><child link="{c}"/></joint>'
        for n, p, c in chain
    )
    told = motion(samples=50, joints=ARM[::-1], urdf=f'<robot name="arm">{"".join(rows)}</robot>')
    path = bags.write(
        replace(told, effort=None), tmp_path / "bag", commands=(told.time[:1], np.arange(3.0)[None])
    )
    for robot_joints in ((), ARM):
        again = bags.read(path, bags.Selection(effort="command", robot_joints=robot_joints))
        assert again.joints == ARM
        np.testing.assert_array_equal(again.require_effort()[0], np.arange(3.0))
        every = bags.read_every(path, bags.Selection(effort="command", robot_joints=robot_joints))
        np.testing.assert_array_equal(every.effort[-1], np.arange(3.0))


def test_a_few_commands_of_another_length_are_left_out(tmp_path: Path) -> None:
    """As in the node: a controller may send an empty one as it starts."""
    recording = replace(motion(samples=50, joints=ARM), effort=None)
    sent = [(), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (7.0,), (8.0, 9.0, 10.0)]
    stamps = [EPOCH + round(0.01 * SECOND * (10 * k - 0.5)) for k in range(len(sent))]
    messages = [
        *states(recording),
        *(("/u", MULTI_ARRAY, t, command(u)) for t, u in zip(stamps, sent, strict=True)),
    ]
    again = bags.read(write_bag(tmp_path / "bag", messages), bags.Selection(effort="command"))
    expected = np.repeat([sent[1], sent[2], sent[4]], (10, 20, 10), axis=0)
    np.testing.assert_array_equal(again.effort, expected)
    assert "2 of 5 commands on /u do not have 3 values; left out." in again.notes[1]
    most = [message for message in messages if message[3] != command(sent[1])]
    with pytest.raises(RecordingError, match="have 0, 1, 3 values"):
        bags.read(write_bag(tmp_path / "most", most), bags.Selection(effort="command"))


def test_a_command_acts_for_half_a_second_at_most(tmp_path: Path) -> None:
    """As in the node: what is commanded every two seconds says nothing of what acts in between."""
    recording, sent = motion(samples=600), np.array([1.0, 3.0])
    path = bags.write(recording, tmp_path / "bag", commands=(sent, np.array([[7.0], [8.0]])))
    again = bags.read(path, bags.Selection(effort="command"))
    np.testing.assert_allclose(
        again.time + again.epoch * 1e-9, recording.epoch * 1e-9 + np.r_[100:151, 300:351] / 100
    )
    np.testing.assert_array_equal(again.require_effort()[:, 0], np.repeat([7.0, 8.0], 51))
    assert (
        "498 samples before the first command, or more than 0.5 s after one, are left out" in again.notes[1]
    )
    late = bags.write(recording, tmp_path / "late", commands=(np.array([9.0]), np.array([[7.0]])))
    with pytest.raises(RecordingError, match=r"no joint state was recorded within 0.5 s after a command"):
        bags.read(late, bags.Selection(effort="command"))


def test_commands_need_their_topic(tmp_path: Path) -> None:
    path = bags.write(motion(), tmp_path / "bag")
    with pytest.raises(UsageError, match="the bag has no effort commands"):
        bags.read(path, bags.Selection(effort="command"))
    messages = [
        *states(motion()),
        ("/u", MULTI_ARRAY, EPOCH, command([1.0], ["x"])),
        ("/w", MULTI_ARRAY, EPOCH, command([2.0])),
    ]
    path = write_bag(tmp_path / "two", messages)
    with pytest.raises(UsageError, match="/u, /w"):
        bags.read(path, bags.Selection(effort="command"))
    np.testing.assert_array_equal(
        bags.read(path, bags.Selection("/joint_states", "/u", "command")).effort, np.ones((51, 1))
    )
    with pytest.raises(UsageError, match="not 'felt'"):
        bags.read(path, bags.Selection(effort="felt"))


METADATA_OF_NO_USE = (
    "relative_file_paths: 5",
    "relative_file_paths: bag.mcap",
    "starting: 2024-13-45",
    "starting: !!timestamp never",
    "compression_mode: [file]",
)


def test_a_directory_without_metadata_or_with_other_profiles_reads(tmp_path: Path) -> None:
    recording = motion(joints=ARM)
    path = write_bag(tmp_path / "bag", states(recording))
    text_before = (path / "metadata.yaml").read_text()
    wrong = [f"rosbag2_bagfile_information: {{{entry}}}" for entry in METADATA_OF_NO_USE]
    for content in (text_before.replace("reliable", "best_effort"), "nonsense: [", 3000 * "[", *wrong, None):
        (path / "metadata.yaml").unlink()
        if content is not None:
            (path / "metadata.yaml").write_text(content)
        assert_equal(bags.read(path), recording)


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_compressed_file_reads_whatever_metadata_says_of_its_profiles(
    tmp_path: Path, storage: StoragePlugin
) -> None:
    recording = motion(joints=ARM)
    path = write_bag(tmp_path / "bag", states(recording), storage, CompressionMode.FILE)
    metadata = path / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("reliable", "best_effort"))
    assert_equal(bags.read(path), recording)
    (file,) = (file for file in path.iterdir() if file != metadata)
    assert file.suffix == ".zstd"
    assert_equal(bags.read(file), recording)


def test_what_a_killed_recorder_had_compressed_already_is_read_with_the_rest(tmp_path: Path) -> None:
    recording = motion(joints=ARM)
    messages, folder = states(recording), tmp_path / "rec"
    folder.mkdir()
    for k, compression in enumerate((CompressionMode.FILE, CompressionMode.FILE, CompressionMode.NONE)):
        part = write_bag(tmp_path / f"{k}", messages[200 * k : 200 * (k + 1)], compression=compression)
        (file,) = (file for file in part.iterdir() if file.name != "metadata.yaml")
        file.rename(folder / f"rec_{file.name}")
    assert sorted(file.name for file in folder.iterdir()) == [
        "rec_0.mcap.zstd",
        "rec_1.mcap.zstd",
        "rec_2.mcap",
    ]
    assert_equal(bags.read(folder), recording)
    whole = folder / "rec_1.mcap.zstd"
    content = whole.read_bytes()
    whole.write_bytes(content[: len(content) // 2])
    with pytest.raises(
        BagError, match=r"rec_1\.mcap\.zstd is truncated or damaged .*`zstd -d`, then `mcap recover` \(of"
    ):
        bags.read(folder)
    whole.with_suffix("").write_bytes(ZstdDecompressor().decompressobj().decompress(content))
    assert_equal(bags.read(folder), recording)  # it was being compressed


@pytest.mark.parametrize("name", ["run#1", "50%25", "what?", "a&b=c"])
def test_a_database_is_read_wherever_it_lies(tmp_path: Path, name: str) -> None:
    recording = motion(joints=ARM)
    write_bag(tmp_path / "bag", states(recording), StoragePlugin.SQLITE3).rename(tmp_path / name)
    assert_equal(bags.read(tmp_path / name), recording)
    (tmp_path / name / "bag.db3").rename(tmp_path / f"{name}.db3")
    assert_equal(bags.read(tmp_path / f"{name}.db3"), recording)


def test_the_directory_around_a_bag_will_do(tmp_path: Path) -> None:
    recording = motion(joints=ARM)
    write_bag(tmp_path / "out" / "bag", states(recording))
    (tmp_path / "out" / "truth.yaml").write_text("effects: []")
    assert_equal(bags.read(tmp_path / "out"), recording)
    write_bag(tmp_path / "out" / "other", states(recording))
    with pytest.raises(UsageError, match=r"holds several bags \(bag, other\)"):
        bags.read(tmp_path / "out")


def test_a_bag_in_several_files_is_one(tmp_path: Path) -> None:
    recording = motion(joints=ARM)
    messages = states(recording)
    path = write_bag(tmp_path / "bag", messages[:400])
    other = write_bag(tmp_path / "bag_1", messages[400:])
    (other / "bag_1.mcap").rename(path / "bag_1.mcap")
    information = yaml.safe_load((path / "metadata.yaml").read_text())
    information["rosbag2_bagfile_information"]["relative_file_paths"].append("bag_1.mcap")
    (path / "metadata.yaml").write_text(yaml.safe_dump(information))
    assert_equal(bags.read(path), recording)
    (path / "bag_1.mcap").unlink()
    with pytest.raises(BagError, match=r"bag_1\.mcap that metadata\.yaml names is missing"):
        bags.read(path)


@pytest.mark.parametrize("names", ["part_{}", "{:c}"], ids=["numbered", "letters against time"])
@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_files_without_metadata_are_read_in_the_order_of_their_time(
    tmp_path: Path, names: str, storage: StoragePlugin
) -> None:
    recording = motion(joints=ARM)
    messages = states(recording)
    (tmp_path / "bag").mkdir()
    for k in range(12):
        part = write_bag(tmp_path / f"{k}", messages[50 * k : 50 * (k + 1)], storage)
        (file,) = (file for file in part.iterdir() if file.suffix != ".yaml")
        file.rename(tmp_path / "bag" / (names.format(k if "part" in names else ord("z") - k) + file.suffix))
    assert_equal(bags.read(tmp_path / "bag"), recording)


def test_files_of_the_same_time_are_read_as_people_count(tmp_path: Path) -> None:
    recording = motion(joints=ARM)
    (tmp_path / "bag").mkdir()
    for k in range(12):
        part = states(recording)[50 * k : 50 * (k + 1)]
        path = write_bag(tmp_path / f"{k}", [(topic, kind, EPOCH, data) for topic, kind, _, data in part])
        (path / f"{k}.mcap").rename(tmp_path / "bag" / f"part_{k}.mcap")
    assert_equal(bags.read(tmp_path / "bag"), recording)


@pytest.mark.parametrize("later", [0.0, 2.0, 7.5])
def test_bags_that_happen_to_be_in_one_folder_are_not_joined(tmp_path: Path, later: float) -> None:
    """The same motion twice would be learned and scored alike; one long after the other is another recording."""
    (tmp_path / "folder").mkdir()
    recording = motion(joints=ARM)
    for name, epoch in (("a", recording.epoch), ("b", recording.epoch + int(later * SECOND))):
        path = write_bag(tmp_path / name, states(replace(recording, epoch=epoch)))
        (path / f"{name}.mcap").rename(tmp_path / "folder" / f"{name}.mcap")
    with pytest.raises(
        UsageError, match=r"several bags \(a.mcap, b.mcap\) that do not follow.*Pass one of them"
    ):
        bags.read(tmp_path / "folder")
    assert_equal(bags.read(tmp_path / "folder" / "a.mcap"), recording)


def test_where_one_is_nothing_is_guessed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty name is that place, too: of a shell variable that is not set."""
    recording = motion(joints=ARM)
    write_bag(tmp_path / "bag", states(recording))
    monkeypatch.chdir(tmp_path)
    for name in (".", ""):
        with pytest.raises(UsageError, match=r"\. holds a bag \(bag\). Pass its name."):
            bags.read(name)
    monkeypatch.chdir(tmp_path / "bag")
    assert_equal(bags.read("."), recording)


def test_topics_that_hold_no_joint_state(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "other", states(motion(), topic="/arm/joint_states"))
    with pytest.raises(UsageError, match="no JointState on /joint_states, but on /arm/joint_states"):
        bags.read(path)
    path = write_bag(tmp_path / "none", [("/chatter", STRING, EPOCH, text("hello"))])
    with pytest.raises(BagError, match=r"holds no sensor_msgs/JointState; its topics are /chatter"):
        bags.read(path)
    for name, topics in (("bare", ()), ("declared", (("/joint_states", JOINT_STATE),))):
        path = write_bag(tmp_path / name, [], topics=topics)
        with pytest.raises(BagError, match="without messages"):
            bags.read(path)


def test_what_is_not_there_or_not_a_bag(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="There is no bag"):
        bags.read(tmp_path / "nothing.mcap")
    with pytest.raises(UsageError, match="directory without a bag"):
        bags.read(tmp_path)
    for name in ("a.mcap", "a.db3"):
        (tmp_path / name).write_bytes(b"")
        with pytest.raises(BagError, match="is empty"):
            bags.read(tmp_path / name)
        (tmp_path / name).write_bytes(b"hello, this is text and not a bag at all" * 9)
        with pytest.raises(BagError, match="not a bag"):
            bags.read(tmp_path / name)
    (tmp_path / "a.txt").write_text("hello")
    with pytest.raises(UsageError, match="not a bag"):
        bags.read(tmp_path / "a.txt")


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_damaged_file_is_never_a_surprise(tmp_path: Path, storage: StoragePlugin) -> None:
    path = next(
        p
        for p in write_bag(tmp_path / "bag", states(motion(samples=300, joints=ARM)), storage).iterdir()
        if p.suffix != ".yaml"
    )
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for length in (9, 20, 60, len(whole) // 3, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(BagError, match=r"truncated or damaged|not a bag"):
            bags.read(path)
    refused = 0
    for _ in range(150):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), 20):
            damaged[place] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            bags.read(path)
        except BdnnError:
            refused += 1
    assert refused


def test_memory_grows_with_the_joint_states_only(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    recording = motion(samples=400, joints=ARM)
    messages = []
    for message in states(recording):
        messages += [message, ("/camera", STRING, message[2], text(rng.bytes(50_000).hex()))]
    path = write_bag(tmp_path / "bag", messages)
    size = (path / "bag.mcap").stat().st_size
    assert size > 40_000_000
    tracemalloc.start()
    try:
        assert_equal(bags.read(path), recording)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < size / 4


def test_progress_is_told(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", states(motion(samples=5000, joints=ARM)))
    told: list[tuple[int, int]] = []
    bags.read(path, progress=lambda done, total: told.append((done, total)))
    assert told[-1] == (5000, 5000)
    assert [done for done, _ in told] == sorted(done for done, _ in told)
    assert len(told) > 2


def test_nothing_is_overwritten_unasked(tmp_path: Path) -> None:
    path = bags.write(motion(), tmp_path / "bag")
    with pytest.raises(UsageError, match="exists already"):
        bags.write(motion(seed=2), path)
    bags.write(motion(seed=2), path, overwrite=True)
    assert_equal(bags.read(path), motion(seed=2))
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "thesis.tex").write_text("years of work")
    with pytest.raises(UsageError, match="not a bag"):
        bags.write(motion(), tmp_path / "precious", overwrite=True)
    plain = bags.write(motion(), tmp_path / "a.mcap")
    bags.write(motion(seed=2), plain, overwrite=True)
    assert_equal(bags.read(plain), motion(seed=2))


@pytest.mark.parametrize("name", ["old", "made", "old.mcap", "made.mcap"])
def test_a_bag_of_any_name_is_overwritten(tmp_path: Path, name: str) -> None:
    path = bags.write(motion(), tmp_path / name)
    bags.write(motion(seed=2), path, overwrite=True)
    assert_equal(bags.read(path), motion(seed=2))
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_a_bag_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    late = replace(motion(), epoch=2**31 * SECOND)
    with pytest.raises(UsageError, match="do not fit a ROS message"):
        bags.write(late, tmp_path / "bag")
    wrong = (np.array([0.0, 1.0]), np.zeros((1, 1)))
    with pytest.raises(ValueError, match="shorter"):
        bags.write(motion(), tmp_path / "bag", commands=wrong)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not DATA.is_dir(), reason="the recordings of real robots are not here")
@pytest.mark.parametrize(
    ("database", "twin"),
    [
        ("panda_unisa/panda_exciting_trajectory.db3", "panda_unisa/panda.mcap"),
        ("ur10_unisa/ur10_exciting_trajectory.db3", "ur10_unisa/ur10.mcap"),
    ],
)
def test_real_recordings_are_the_same_in_both_formats(database: str, twin: str) -> None:
    left, right = bags.read(DATA / database), bags.read(DATA / twin)
    np.testing.assert_array_equal(left.time, right.time)
    for field in ("position", "velocity", "effort"):  # the twin was rounded to single precision
        np.testing.assert_array_equal(
            getattr(left, field).astype(np.float32), getattr(right, field).astype(np.float32)
        )


@pytest.mark.skipif(not DATA.is_dir(), reason="the recordings of real robots are not here")
def test_a_real_recording_without_velocity() -> None:
    recording = bags.read(DATA / "tx40_figaroh" / "tx40.mcap")
    assert (len(recording), recording.width, recording.velocity) == (45000, 6, None)
    assert recording.effort is not None and recording.urdf is not None
    assert recording.rate == pytest.approx(5000.0)


def test_both_readers_count_time_from_the_first_joint_state_whatever_is_left_out(tmp_path: Path) -> None:
    """A push that was found in one must be at the same moment in the other."""
    recording = motion(samples=400)
    blind = recording.position.copy()
    blind[:150] = np.nan
    unknown = [
        (topic, kind, log, joint_state(("pivot",), q, (), u, log))
        for (topic, kind, log, _), q, u in zip(
            states(recording), blind, recording.require_effort(), strict=True
        )
    ]
    commands = [("/u", MULTI_ARRAY, EPOCH + k * SECOND // 10, command([float(k)])) for k in range(20, 40)]
    bag = write_bag(tmp_path / "bag", sorted([*states(recording), *commands], key=lambda message: message[2]))
    blinded = write_bag(tmp_path / "blinded", unknown)
    for begins, lacks, found, every in (
        (
            2.0,
            0.0,
            bags.read(bag, bags.Selection(effort="command")),
            bags.read_every(bag, bags.Selection(effort="command")),
        ),
        (1.5, 1.5, bags.read(blinded, drop_invalid=True), bags.read_every(blinded, drop_invalid=True)),
    ):
        assert found.epoch == every.motion.epoch == EPOCH
        assert (found.time[0], every.motion.time[0]) == pytest.approx((begins, lacks), abs=1e-9)
