"""Reads a bag for playback: joint states, and effort commands in their recorded order between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bdnn_ros.bags.commands import Commands
from bdnn_ros.bags.reading import recording_of, samples_of
from bdnn_ros.bags.selection import Selection
from bdnn_ros.bags.storage import Storage
from bdnn_ros.efforts import COMMAND_AGE
from bdnn_ros.errors import RecordingError
from bdnn_ros.recording import Recording


@dataclass(frozen=True)
class Played:
    """Joint states, and the commands that are in force at some of them.

    Attributes:
        recording: the joint states.
        commands: the values of each command as they were recorded, (k,) each.
        row: of the first joint state that was recorded after each command, (M,) int, in order.
        due: when each command was recorded, on the clock of the recording [s], (M,): between that joint state and
            the one before, whatever the headers' stamps.
    """

    recording: Recording
    commands: list[np.ndarray]
    row: np.ndarray
    due: np.ndarray


def read_to_play(
    path: str | Path, joint_states: str, effort_commands: str = "", rename: Sequence[str] = ()
) -> Played:
    """Read the joint states, without unusable ones, and the commands on a topic if it is given.

    Raises:
        UsageError, BagError, RecordingError: as `read`.
    """
    samples, urdf, notes = samples_of(path, Selection(joint_states, rename=rename))
    recording, rows = recording_of(str(path), samples, urdf, notes, drop_invalid=True)
    if not effort_commands or not len(recording):
        return Played(recording, [], np.zeros(0, int), np.zeros(0))
    commands = _commands(Path(path), effort_commands)
    recording = replace(recording, notes=(*recording.notes, *commands.checked()))
    times, values = commands.recorded()
    played = _placed(recording, samples.log[rows], times, values)
    if not played.commands:
        raise RecordingError(
            f"{path}: no joint state was recorded within {COMMAND_AGE:g} s after a command on {effort_commands}.",
            "Record both topics together.",
        )
    return played


def _commands(path: Path, topic: str) -> Commands:
    """The commands on a topic."""
    with Storage(path) as storage:
        commands = Commands(str(path), topic, storage.topics)
        for _, log, data in storage.messages({topic}):
            commands.add(log, data)
    return commands


def _placed(
    recording: Recording, logs: np.ndarray, times: np.ndarray, values: Sequence[np.ndarray]
) -> Played:
    """The commands between the joint states, by the time at which both were recorded.

    Commands after the last joint state, or too long before the first to be in force there, are dropped.
    """
    logs = np.maximum.accumulate(logs)
    row = np.searchsorted(logs, times)
    used = (row < len(logs)) & (times >= logs[0] - int(COMMAND_AGE * 1e9))
    times, row = times[used], row[used]
    before = np.where(row > 0, recording.time[np.maximum(row - 1, 0)], recording.time[0])
    due = np.maximum(recording.time[row] - (logs[row] - times) * 1e-9, before)
    return Played(recording, [values[k] for k in np.flatnonzero(used).tolist()], row, due)
