"""A bag becomes a Recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bdnn_ros.bags.clock import begun, stamped
from bdnn_ros.bags.commands import Commands
from bdnn_ros.bags.description import Descriptions, movable_joints
from bdnn_ros.bags.joint_states import JointStates, Samples
from bdnn_ros.bags.left_over import LeftOver, subject
from bdnn_ros.bags.merging import together
from bdnn_ros.bags.reported import reported_effort
from bdnn_ros.bags.storage import JOINT_STATE, Storage, Topic
from bdnn_ros.errors import BagError, UsageError, listed
from bdnn_ros.recording import Recording, cleaned, renamed
from bdnn_ros.reported import reported_velocity, with_derived

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
    """The joint states of a bag as a recording; its time 0 is that of the first joint state, even if that is left out.

    Messages are streamed: memory holds the joint data and one chunk, not the file. Stamps are those of the
    headers; where all of these are zero, those of the recorder. Joints that come in messages of their own are put
    together by the stamps.

    Args:
        path: `.mcap` file, `.db3` file or rosbag2 directory.
        joint_states: topic of sensor_msgs/JointState.
        effort_commands: topic of std_msgs/Float64MultiArray; None takes the bag's only one.
        effort: "measured" is JointState.effort; "command" is the command last recorded before each of them,
            not longer ago than `efforts.COMMAND_AGE`. Its values stand for `joints`, `robot_joints` (or those of the
            description in the bag) or the joints of the messages, the first that fits.
        drop_invalid: as of `recording.cleaned`, instead of refusing the bag.
        rename: rules as in `Recording.rename`, applied before joints are chosen.
        joints: the joints to read, all needed, in this order; with commands, those that no message holds only have a
            place among their values.
        robot_joints: without `joints`, those of these that the bag has, in this order, but for those whose messages
            do not fit to the others'. Without either, the robot description in the bag says the joints; where there
            is none, all of one message are read.

    Raises:
        UsageError: there is no such file, topic or joint.
        BagError: not a bag, damaged, or without the messages needed.
        RecordingError: as `recording.cleaned`.
    """
    samples, urdf, notes = samples_of(
        path,
        joint_states,
        effort_commands,
        effort,
        progress,
        rename=rename,
        joints=joints,
        robot_joints=robot_joints,
    )
    return recording_of(str(path), samples, urdf, drop_invalid, notes)[0]


def samples_of(
    path: str | Path,
    joint_states: str,
    effort_commands: str | None,
    effort: str,
    progress: Progress | None,
    *,
    rename: Sequence[str],
    joints: Sequence[str],
    robot_joints: Sequence[str],
    every: bool = False,
) -> tuple[Samples, str | None, list[str]]:
    """The joint states of a bag as they are in it, its robot description, and what there is to say.

    What is not told of here is as of `read`.

    Args:
        every: leave out no message that holds the joints (or most of them, where none holds all); what is unknown
            then is NaN.

    Raises:
        UsageError, BagError: as `read`.
    """
    name = str(path)
    states, commands, descriptions = collected(path, joint_states, effort_commands, effort, progress)
    urdf = descriptions.theirs
    old = states.joints
    new = renamed(old, rename)
    described = tuple(robot_joints) or movable_joints(urdf)
    held = [joint for joint in joints if commands is None or joint in new] or joints
    wanted = _wanted(name, states.groups, dict(zip(old, new, strict=True)), held, described)
    main = tuple(new[old.index(joint)] for joint in states.groups[0])
    samples, notes = _samples(
        name, states, dict(zip(new, old, strict=True)), wanted, bool(joints), commands, every
    )
    if commands is None:
        samples, more = reported_effort(name, samples)
    else:
        said = commands.checked()
        samples, more = commands.aligned(samples, [tuple(joints), described, main], every)
        more = said + more
    return samples, urdf, [*descriptions.notes(name), *notes, *more]


def collected(
    path: str | Path, joint_states: str, effort_commands: str | None, effort: str, progress: Progress | None
) -> tuple[JointStates, Commands | None, Descriptions]:
    """The joint states of a bag, at least one; the commands, where they are the effort; the robot descriptions.

    Raises:
        UsageError, BagError: as `read`.
    """
    name = str(path)
    if effort not in ("measured", "command"):
        raise UsageError(f"The effort is measured or command, not {effort!r}.", "Choose one of these.")
    with Storage(Path(path)) as storage:
        available = storage.topics
        _require_joint_states(name, joint_states, available)
        commands = Commands(name, effort_commands, available) if effort == "command" else None
        states, descriptions = _collect(storage, joint_states, commands, progress)
    if not states.joints:
        raise _none(name, states, joint_states)
    return states, commands, descriptions


def _collect(
    storage: Storage, joint_states: str, commands: Commands | None, progress: Progress | None
) -> tuple[JointStates, Descriptions]:
    states, descriptions = JointStates(), Descriptions(joint_states, storage.topics)
    wanted = {joint_states, *descriptions.topics} | ({commands.topic} if commands else set())
    total = sum(t.count for t in storage.topics if t.name in wanted)
    for count, (topic, log, data) in enumerate(storage.messages(wanted)):
        if topic == joint_states:
            states.add(log, data)
        elif commands is not None and topic == commands.topic:
            commands.add(log, data)
        else:
            descriptions.add(topic, data)
        if progress is not None and count % REPORT_EVERY == 0:
            progress(count, total)
    states.flush()
    if progress is not None:
        progress(total, total)
    return states, descriptions


def _require_joint_states(name: str, topic: str, available: Sequence[Topic]) -> None:
    suitable = [t.name for t in available if t.type == JOINT_STATE and t.count]
    if topic in suitable:
        return
    if suitable:
        raise UsageError(
            f"{name}: no JointState on {topic}, but on {listed(suitable)}.",
            f"Choose it with --joint-states {suitable[0]}.",
        )
    if not any(t.count for t in available):
        raise BagError(f"{name} is a bag without messages.", "Record it again while the robot moves.")
    raise BagError(
        f"{name} holds no sensor_msgs/JointState; its topics are {listed(t.name for t in available)}.",
        "Record the topic /joint_states.",
    )


def _none(name: str, states: JointStates, topic: str) -> BagError:
    """Why no joint state can be used."""
    if states.malformed:
        first = states.malformed[0]
        return BagError(
            f"{name}: no message on {topic} can be decoded ({first.problem.rstrip('.')}).", first.remedy
        )
    return BagError(
        f"{name}: the messages on {topic} name no joint with a position.",
        "Record a driver that names its joints and fills JointState.position.",
    )


def _wanted(
    name: str,
    groups: Sequence[tuple[str, ...]],
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
                f"{name}: {subject(missing)} not in the recording, which has {listed(every, 20)}.",
                "Name the joints with --joints, or map the names with --rename old=new.",
            )
        if len(set(joints)) != len(joints):
            raise UsageError(f"A joint is named twice in {listed(joints, 20)}.", "Name each joint once.")
        return tuple(joints)
    common = tuple(joint for joint in robot_joints if joint in every)
    return common or tuple(renaming[joint] for joint in groups[0])


def _samples(
    name: str,
    states: JointStates,
    old: dict[str, str],
    wanted: Sequence[str],
    needed: bool,
    commands: Commands | None,
    every: bool,
) -> tuple[Samples, list[str]]:
    """The joint states of the joints that are wanted, or needed, by their new names, and what there is to say."""
    new = {theirs: ours for ours, theirs in old.items()}
    parts = states.together([old[joint] for joint in wanted])
    if commands is not None and not needed and not commands.stand_for(len(wanted)):
        parts = parts[:1]
    found = [
        replace(part, joints=tuple(new[joint] for joint in part.joints)) for part in states.samples(parts)
    ]
    clocked, notes = stamped(name, found, every)
    samples, more = together(name, clocked, wanted, needed=needed, measured=commands is None, every=every)
    unused = [joint for joint in old if not any(joint in part.joints for part in found)]
    samples = replace(samples, epoch=begun(clocked[0].stamp))
    return samples, [*_notes(name, states, sum(map(len, found)), unused), *notes, *more]


def _notes(name: str, states: JointStates, held: int, unused: Sequence[str]) -> list[str]:
    notes: list[str] = []
    if unused:
        notes.append(LeftOver.of(name, unused))
    if held < states.usable:
        notes.append(
            f"{name}: {states.usable - held} of {states.count} joint states hold other joints or come from another "
            "publisher; left out."
        )
    if states.nameless:
        notes.append(
            f"{name}: {states.nameless} of {states.count} joint states lack names or position; left out."
        )
    if states.malformed:
        notes.append(
            f"{name}: {len(states.malformed)} of {states.count} joint states cannot be decoded "
            f"({states.malformed[0].problem.rstrip('.')}); left out."
        )
    return notes


def recording_of(
    name: str, samples: Samples, urdf: str | None, drop_invalid: bool, notes: list[str]
) -> tuple[Recording, np.ndarray]:
    """The recording of samples, and which of them it holds: fields that nobody measured recognised."""
    velocity, silent, more = reported_velocity(name, samples.joints, samples.position, samples.velocity)
    effort, also = samples.effort, []
    if effort is not None:
        absent = np.isnan(effort).all(axis=0)
        if absent.any() and not absent.all():
            which = listed(np.array(samples.joints)[absent])
            also.append(f"{name}: no effort is reported for {which} (NaN throughout): not measured there.")
            effort = np.where(absent, 0.0, effort)
    recording, rows = cleaned(
        (samples.stamp - samples.epoch) * 1e-9,
        samples.joints,
        samples.position,
        velocity,
        effort,
        name=name,
        urdf=urdf,
        drop_invalid=drop_invalid,
    )
    recording = with_derived(recording, silent)
    return replace(recording, epoch=samples.epoch, notes=(*notes, *more, *also, *recording.notes)), rows
