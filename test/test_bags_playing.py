"""What a bag is played as: commands keep their values, their number and their place among the joint states."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bag_cases import EPOCH, JOINT_STATE, MULTI_ARRAY, command, joint_state, motion, states, write_bag

from bdnn_ros import bags
from bdnn_ros.errors import RecordingError, UsageError

JOINTS = ("shoulder", "elbow", "finger")
MS = 1_000_000


def test_commands_are_played_as_they_were_recorded(tmp_path: Path) -> None:
    """Their values are nobody's to arrange: they stand for the controller's joints, in the controller's order."""
    recording = motion(samples=50, joints=JOINTS)
    sent = np.array([-0.9, -0.2, 0.095, 0.1, 0.2, 0.202, 0.2071, 0.4901])
    values = np.arange(16.0).reshape(8, 2)
    path = bags.write(recording, tmp_path / "bag", commands=(sent, values))
    played = bags.read_to_play(path, "/joint_states", "/effort_commands")
    assert len(played.recording) == 50 and played.recording.joints == JOINTS
    np.testing.assert_array_equal(played.recording.position, bags.read(path).position)
    np.testing.assert_array_equal(played.commands, values[1:7])  # one came too early, one after the end
    np.testing.assert_array_equal(played.row, [0, 10, 10, 20, 21, 21])
    np.testing.assert_allclose(played.due, [0.0, 0.095, 0.1, 0.2, 0.202, 0.2071], atol=1e-6)
    assert bags.read_to_play(path, "/joint_states").commands == []


def test_commands_stand_where_the_recorder_got_them_whatever_the_stamps(tmp_path: Path) -> None:
    """Stamps by another clock, late by unequal times; joint states that cannot be used, and a clock set back."""
    count = 60
    stamps = 5_000 * MS + 10 * MS * np.arange(count)
    stamps[30:] -= 3_000 * MS
    logs = EPOCH + 10 * MS * np.arange(count) + np.where(np.arange(count) % 2, 4 * MS, 0)
    position = np.sin(0.1 * np.arange(count))
    position[[5, 40]] = np.nan
    messages = [
        ("/joint_states", JOINT_STATE, int(log), joint_state(["a"], [q], stamp=int(stamp)))
        for log, stamp, q in zip(logs, stamps, position, strict=True)
    ]
    messages += [("/u", MULTI_ARRAY, int(log) - MS, command([k])) for k, log in enumerate(logs)]
    played = bags.read_to_play(
        write_bag(tmp_path / "bag", sorted(messages, key=lambda m: m[2])), "/joint_states", "/u"
    )
    kept = np.setdiff1d(np.arange(count), [5, 40])
    np.testing.assert_array_equal(played.recording.position[:, 0], position[kept])
    np.testing.assert_array_equal(np.ravel(played.commands), np.arange(count))
    np.testing.assert_array_equal(played.row, np.searchsorted(kept, np.arange(count)))
    time = played.recording.time
    assert (np.diff(played.due) >= 0).all() and (played.due <= time[played.row]).all()


def test_commands_that_cannot_be_played_are_told_of(tmp_path: Path) -> None:
    path = write_bag(
        tmp_path / "bag", [*states(motion()), ("/u", MULTI_ARRAY, EPOCH + 60_000 * MS, command([1.0]))]
    )
    with pytest.raises(
        RecordingError, match=r"no joint state was recorded within 0\.5 s after a command on /u"
    ):
        bags.read_to_play(path, "/joint_states", "/u")
    with pytest.raises(UsageError, match="no effort commands"):
        bags.read_to_play(path, "/joint_states", "/w")


def test_what_is_played_is_what_is_read(tmp_path: Path) -> None:
    still = motion(samples=50, joints=JOINTS)
    fields = {
        "all": still,
        "position": replace(still, velocity=None, effort=None),
        "no velocity of one": replace(still, velocity=still.velocity * [0.0, 1.0, 1.0]),
        "no velocity of any": replace(still, velocity=0.0 * still.velocity),
        "no effort": replace(still, effort=0.0 * still.effort),
    }
    for name, recording in fields.items():
        path = bags.write(recording, tmp_path / name.replace(" ", "_"))
        plain, played = bags.read(path, drop_invalid=True), bags.read_to_play(path, "/joint_states").recording
        assert (plain.notes, plain.joints, plain.epoch) == (played.notes, played.joints, played.epoch), name
        for field in ("time", "position", "velocity", "effort"):
            np.testing.assert_array_equal(getattr(plain, field), getattr(played, field), err_msg=name)
