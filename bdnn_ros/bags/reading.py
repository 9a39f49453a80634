"""Reads a bag as a recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bdnn_ros.bags.clock import begun, stamped
from bdnn_ros.bags.commands import Commands
from bdnn_ros.bags.description import Descriptions, movable_joints
from bdnn_ros.bags.joint_states import JointStates, Samples
from bdnn_ros.bags.left_over import LeftOver
from bdnn_ros.bags.merging import together
from bdnn_ros.bags.reported import reported_effort
from bdnn_ros.bags.selection import Selection, available_joints
from bdnn_ros.bags.storage import JOINT_STATE, Storage, Topic
from bdnn_ros.errors import BagError, UsageError, listed
from bdnn_ros.recording import Recording, cleaned, renamed
from bdnn_ros.reported import reported_velocity, with_derived

REPORT_EVERY = 2048
"""Messages between two reports of progress."""

Progress = Callable[[int, int], None]
"""Called with the number of messages read so far and their total."""
EVERYTHING = Selection()


def topics(path: str | Path) -> list[Topic]:
    """The topics of a bag, in the order of their names.

    Raises:
        BagError, UsageError: as `read`.
    """
    with Storage(Path(path)) as storage:
        return storage.topics


def read(
    path: str | Path,
    selection: Selection = EVERYTHING,
    *,
    drop_invalid: bool = False,
    progress: Progress | None = None,
) -> Recording:
    """Read the joint states of a bag as a recording.

    Time 0 is the stamp of the first joint state, even if that one is dropped. Messages are streamed: memory holds the
    joint data and one chunk of the file, never the whole file. Stamps are those of the headers, or the recorder's if all
    header stamps are zero. Joints that are published in separate messages are merged by their stamps.

    Args:
        path: `.mcap` file, `.db3` file or rosbag2 directory.
        drop_invalid: as of `recording.cleaned`, instead of refusing the bag.

    Raises:
        UsageError: there is no such file, topic or joint.
        BagError: not a bag, damaged, or without the messages needed.
        RecordingError: as `recording.cleaned`.
    """
    return recording_of(str(path), *samples_of(path, selection, progress), drop_invalid=drop_invalid)[0]


def samples_of(
    path: str | Path, selection: Selection, progress: Progress | None = None, every: bool = False
) -> tuple[Samples, str | None, list[str]]:
    """Read the joint states of a bag unfiltered, its robot description, and notes for the user.

    Args:
        every: drop no message that holds the joints (or most of them, where none holds all); unknown values are NaN.

    Raises:
        UsageError, BagError: as `read`.
    """
    name, joints = str(path), selection.joints
    states, commands, descriptions = collected(path, selection, progress)
    urdf = descriptions.theirs
    new = dict(zip(states.joints, renamed(states.joints, selection.rename), strict=True))
    main = tuple(new[joint] for joint in states.groups[0])
    described = tuple(selection.robot_joints) or movable_joints(urdf)
    names = list(new.values())
    held = [joint for joint in joints if commands is None or joint in names] or joints
    wanted = available_joints(name, held, described, names, main)
    samples, notes = _samples(name, states, new, wanted, bool(joints), commands, every)
    if commands is None:
        samples, more = reported_effort(name, samples)
    else:
        said = commands.checked()
        samples, more = commands.aligned(samples, [tuple(joints), described, main], every)
        more = said + more
    return samples, urdf, [*descriptions.notes(name), *notes, *more]


def collected(
    path: str | Path, selection: Selection, progress: Progress | None
) -> tuple[JointStates, Commands | None, Descriptions]:
    """The joint states of a bag, at least one; the effort commands, if they are selected; the robot descriptions.

    Raises:
        UsageError, BagError: as `read`.
    """
    name, topic = str(path), selection.joint_states
    with Storage(Path(path)) as storage:
        available = storage.topics
        _require_joint_states(name, topic, available)
        commanded = selection.effort == "command"
        commands = Commands(name, selection.effort_commands, available) if commanded else None
        states, descriptions = _collect(storage, topic, commands, progress)
    if not states.joints:
        raise _none(name, states, topic)
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
    """The error if no joint state is usable."""
    if states.malformed:
        first = states.malformed[0]
        return BagError(
            f"{name}: no message on {topic} can be decoded ({first.problem.rstrip('.')}).", first.remedy
        )
    return BagError(
        f"{name}: the messages on {topic} name no joint with a position.",
        "Record a driver that names its joints and fills JointState.position.",
    )


def _samples(
    name: str,
    states: JointStates,
    new: dict[str, str],
    wanted: Sequence[str],
    needed: bool,
    commands: Commands | None,
    every: bool,
) -> tuple[Samples, list[str]]:
    """The merged joint states of the wanted joints, and notes for the user.

    Args:
        new: names after renaming, by those in the bag.
        needed: refuse a bag whose messages cannot be merged so that all wanted joints are in it.
    """
    old = {ours: theirs for theirs, ours in new.items()}
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
    name: str, samples: Samples, urdf: str | None, notes: Sequence[str], *, drop_invalid: bool
) -> tuple[Recording, np.ndarray]:
    """The recording of samples without fields that were never measured, and which of the samples it holds."""
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
