"""A bag becomes a Recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bdnn_ros.bags.cdr import MalformedMessage, decode_float64_multi_array, decode_string
from bdnn_ros.bags.description import movable_joints
from bdnn_ros.bags.joint_states import JointStates, Samples
from bdnn_ros.bags.storage import Storage, Topic
from bdnn_ros.errors import BagError, RecordingError, UsageError, listed
from bdnn_ros.recording import Recording, cleaned, renamed

JOINT_STATE = "sensor_msgs/msg/JointState"
MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
STRING = "std_msgs/msg/String"
MOVES = 0.01
"""A joint that covers this much [rad] and reports a velocity of zero throughout does not report it."""
REPORT_EVERY = 2048
"""Messages between two reports of progress."""

Progress = Callable[[int, int], None]
"""Told how many messages are read, and of how many."""


def topics(path: str | Path) -> list[Topic]:
    """The topics of a bag, in the order of their names.

    Raises:
        BagError, UsageError: as `read`.
    """
    with Storage(Path(path)) as storage:
        return storage.topics


def read(
    path: str | Path,
    joint_states: str = "/joint_states",
    effort_commands: str | None = None,
    effort: str = "measured",
    drop_invalid: bool = False,
    progress: Progress | None = None,
    *,
    rename: Sequence[str] = (),
    joints: Sequence[str] = (),
    robot_joints: Sequence[str] = (),
) -> Recording:
    """The joint states of a bag as a recording that starts at time 0.

    Messages are streamed: memory holds the joint data and one chunk, not the file. Stamps are those of the
    headers; where all of these are zero, those of the recorder.

    Args:
        path: `.mcap` file, `.db3` file or rosbag2 directory.
        joint_states: topic of sensor_msgs/JointState.
        effort_commands: topic of std_msgs/Float64MultiArray; None takes the bag's only one.
        effort: "measured" is JointState.effort; "command" is the command last recorded before each of them.
            Its values stand for `joints`, `robot_joints` or the joints of the messages, the first that fits.
        drop_invalid: leave out samples that are not finite or go back in time, instead of refusing the bag.
        rename: rules as in `Recording.rename`, applied before joints are chosen.
        joints: the joints to read, all needed, in this order.
        robot_joints: without `joints`, those of these that the bag has, in this order. Without either, the
            robot description in the bag says the joints; where there is none, all of one message are read.

    Raises:
        UsageError: there is no such file, topic or joint.
        BagError: not a bag, damaged, or without the messages needed.
        RecordingError: as `recording.cleaned`.
    """
    name = str(path)
    if effort not in ("measured", "command"):
        raise UsageError(f"The effort is measured or command, not {effort!r}.", "Choose one of these.")
    with Storage(Path(path)) as storage:
        available = storage.topics
        _require_joint_states(name, joint_states, available)
        commands = _Commands(name, effort_commands, available) if effort == "command" else None
        states, urdf = _collect(storage, joint_states, commands, progress)
    old = states.joints
    if not old:
        raise BagError(
            f"{name}: {_why_none(states, joint_states)}.", "Record a driver that names its joints."
        )
    new = renamed(old, rename)
    chosen = _choose(
        name, states, dict(zip(old, new, strict=True)), joints, robot_joints or movable_joints(urdf)
    )
    main = tuple(new[old.index(joint)] for joint in states.groups[0])
    samples = states.samples([old[new.index(joint)] for joint in chosen])
    if not len(samples):
        raise BagError(
            f"{name}: no message holds {listed(chosen, 20)} together.",
            "Choose joints of one message with --joints.",
        )
    samples = replace(samples, joints=chosen)
    notes = _notes(name, states, samples, [joint for joint in new if joint not in chosen])
    if commands is not None:
        samples, more = commands.aligned(samples, [tuple(joints), tuple(robot_joints), main])
        notes += more
    return _recording(name, samples, urdf, drop_invalid, notes)


def _collect(
    storage: Storage, joint_states: str, commands: _Commands | None, progress: Progress | None
) -> tuple[JointStates, str | None]:
    states, urdf = JointStates(), None
    descriptions = {joint_states.rpartition("/")[0] + "/robot_description", "/robot_description"}
    wanted = {joint_states} | ({commands.topic} if commands else set())
    wanted |= {t.name for t in storage.topics if t.name in descriptions and t.type == STRING}
    total = sum(t.count for t in storage.topics if t.name in wanted)
    for count, (topic, log, data) in enumerate(storage.messages(wanted)):
        if topic == joint_states:
            states.add(log, data)
        else:
            try:
                if commands is not None and topic == commands.topic:
                    commands.add(log, data)
                else:
                    urdf = decode_string(data) or urdf
            except MalformedMessage as error:
                raise BagError(f"{storage.path}: {topic} cannot be decoded.", error.problem) from None
        if progress is not None and count % REPORT_EVERY == 0:
            progress(count, total)
    states.flush()
    if progress is not None:
        progress(total, total)
    return states, urdf


def _require_joint_states(name: str, topic: str, available: Sequence[Topic]) -> None:
    suitable = [t.name for t in available if t.type == JOINT_STATE and t.count]
    if topic in suitable:
        return
    if suitable:
        raise BagError(
            f"{name}: no JointState on {topic}, but on {listed(suitable)}.",
            f"Choose it with --joint-states {suitable[0]}.",
        )
    if not any(t.count for t in available):
        raise BagError(f"{name} is a bag without messages.", "Record it again while the robot moves.")
    raise BagError(
        f"{name} holds no sensor_msgs/JointState; its topics are {listed(t.name for t in available)}.",
        "Record the topic /joint_states.",
    )


def _why_none(states: JointStates, topic: str) -> str:
    if states.malformed:
        return f"no message on {topic} can be decoded ({states.malformed[0].rstrip('.')})"
    return f"the messages on {topic} name no joint with a position"


def _choose(
    name: str,
    states: JointStates,
    renaming: dict[str, str],
    joints: Sequence[str],
    robot_joints: Sequence[str],
) -> tuple[str, ...]:
    """The joints to read, by their new names."""
    every = tuple(renaming.values())
    if joints:
        missing = [joint for joint in joints if joint not in every]
        if missing:
            raise UsageError(
                f"{name}: joint {listed(missing)} is not in the recording, which has {listed(every, 20)}.",
                "Name the joints with --joints, or map the names with --rename old=new.",
            )
        if len(set(joints)) != len(joints):
            raise UsageError(f"A joint is named twice in {listed(joints, 20)}.", "Name each joint once.")
        return tuple(joints)
    best: tuple[str, ...] = ()
    groups = states.groups
    for group in groups:
        held = {renaming[joint] for joint in group}
        common = tuple(joint for joint in robot_joints if joint in held)
        best = common if len(common) > len(best) else best
    return best or tuple(renaming[joint] for joint in groups[0])


def _notes(name: str, states: JointStates, samples: Samples, unused: Sequence[str]) -> list[str]:
    notes = []
    if unused:
        notes.append(f"{name}: joints {listed(unused)} of the bag are left out.")
    if samples.left_out:
        notes.append(
            f"{name}: {samples.left_out} of {states.count} joint states hold other joints; left out."
        )
    if states.nameless:
        notes.append(
            f"{name}: {states.nameless} of {states.count} joint states lack names or position; left out."
        )
    if states.malformed:
        notes.append(
            f"{name}: {len(states.malformed)} of {states.count} joint states cannot be decoded "
            f"({states.malformed[0].rstrip('.')}); left out."
        )
    return notes


class _Commands:
    """Effort commands against the time of their recording."""

    def __init__(self, name: str, topic: str | None, available: Sequence[Topic]) -> None:
        suitable = [t.name for t in available if t.type == MULTI_ARRAY and t.count]
        if topic is None and len(suitable) == 1:
            topic = suitable[0]
        if topic not in suitable:
            where = f"on {topic}" if topic else "that is the only one"
            there = f"Float64MultiArray is on {listed(suitable)}" if suitable else "the bag has none at all"
            raise UsageError(
                f"{name}: no effort commands (std_msgs/Float64MultiArray) {where}; {there}.",
                "Name the topic with --effort-commands, or use --effort measured.",
            )
        self.name = name
        self.topic: str = str(topic)
        self._logs: list[int] = []
        self._values: list[np.ndarray] = []

    def add(self, log: int, data: bytes) -> None:
        """Takes one message: its log time [ns] and its bytes."""
        self._values.append(decode_float64_multi_array(data))
        self._logs.append(log)

    def aligned(self, samples: Samples, orders: Sequence[tuple[str, ...]]) -> tuple[Samples, list[str]]:
        """The samples with the command last recorded before each as effort, without those before the first.

        Args:
            orders: joint names the commands may stand for, the likeliest first.
        """
        widths = {len(values) for values in self._values}
        fitting = [
            names for names in orders if names and widths == {len(names)} and {*samples.joints} <= {*names}
        ]
        if not fitting:
            raise RecordingError(
                f"{self.name}: the commands on {self.topic} have {listed(sorted(widths))} values, "
                f"the joints chosen are {listed(samples.joints, 20)}.",
                "Name the joints of the commands in their order with --joints.",
            )
        columns = [fitting[0].index(joint) for joint in samples.joints]
        logs = np.array(self._logs)
        order = np.argsort(logs, kind="stable")
        latest = np.searchsorted(logs[order], samples.log, side="right") - 1
        rows = latest >= 0
        notes = [f"{self.name}: effort is commanded on {self.topic}, in the order {listed(fitting[0], 20)}."]
        if not rows.all():
            notes.append(
                f"{self.name}: {np.count_nonzero(~rows)} samples before the first command are left out."
            )
        values = np.array(self._values)[order][:, columns]
        return (
            replace(
                samples,
                log=samples.log[rows],
                stamp=samples.stamp[rows],
                position=samples.position[rows],
                velocity=None if samples.velocity is None else samples.velocity[rows],
                effort=values[latest[rows]],
            ),
            notes,
        )


def _recording(
    name: str, samples: Samples, urdf: str | None, drop_invalid: bool, notes: list[str]
) -> Recording:
    """The recording of samples: its clock chosen, fields that nobody measured recognised."""
    stamps = samples.stamp
    if not stamps.any() and len(stamps) > 1:
        stamps = samples.log
        notes.append(f"{name}: all header stamps are zero; the recorder's are taken.")
    velocity, effort = samples.velocity, samples.effort
    if velocity is not None:
        unknown = ~(np.isfinite(velocity) & (velocity != 0.0)).any(axis=0)
        moves = np.ptp(samples.position, axis=0) > MOVES if len(stamps) else unknown
        partly = np.isnan(velocity).all(axis=1)
        silent = (unknown & moves) | np.isnan(velocity).all(axis=0)
        if silent.any() or (partly.any() and not partly.all()):
            which = listed(np.array(samples.joints)[silent]) if silent.any() else f"{partly.sum()} samples"
            notes.append(f"{name}: no velocity is reported for {which}; it is derived from the position.")
            velocity = None
    if effort is not None:
        absent = np.isnan(effort).all(axis=0)
        if absent.any() and not absent.all():
            which = listed(np.array(samples.joints)[absent])
            notes.append(f"{name}: no effort is reported for {which} (NaN throughout); it counts as zero.")
            effort = np.where(absent, 0.0, effort)
        if not np.nan_to_num(effort).any():
            notes.append(f"{name}: every effort is zero or NaN; taken as not measured.")
            effort = None
    epoch = int(stamps[0]) if len(stamps) else 0
    recording = cleaned(
        (stamps - epoch) * 1e-9,
        samples.joints,
        samples.position,
        velocity,
        effort,
        name=name,
        urdf=urdf,
        drop_invalid=drop_invalid,
    )
    return replace(recording, epoch=epoch, notes=(*notes, *recording.notes))
