"""Joints that are left out stand, or are told to move, by all that a bag holds of their positions, whoever tells it."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bag_cases import EPOCH, JOINT_STATE, MULTI_ARRAY, STRING, Message, command, joint_state, text, write_bag
from live_support import motion

from bdnn_ros import bags
from bdnn_ros.cli import loading, options
from bdnn_ros.errors import UsageError
from bdnn_ros.left_out import beside
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm6")
ELBOW = ARM.joints[2]
OTHERS = tuple(joint for joint in ARM.joints if joint != ELBOW)
STANDS = 1.2
COMMANDED = "beside commands of the others alone"
LACKING = "by a message that lacks its effort"


def bent(moves: bool) -> Recording:
    """A motion of the arm, its elbow bent or moving."""
    moved = motion(ARM, 8.0, 100.0, seed=1)
    position = moved.position.copy()
    if not moves:
        position[:, 2] = STANDS
    return replace(moved, position=position, epoch=EPOCH)


def said(
    joints: Sequence[str], seen: Recording, every: int = 1, effort: np.ndarray | None = None
) -> Iterable[Message]:
    """Messages of some joints at every so many samples."""
    columns = [seen.joints.index(joint) for joint in joints]
    for row in range(0, len(seen), every):
        stamp = EPOCH + round(seen.time[row] * 1e9)
        efforts = () if effort is None else effort[row, columns]
        data = joint_state(joints, seen.position[row, columns], (), efforts, stamp)
        yield "/joint_states", JOINT_STATE, stamp, data


def told(seen: Recording, how: str) -> list[Message]:
    """Messages of a motion of the arm, of the elbow in some way."""
    effort = np.array(seen.require_effort())
    description = ("/robot_description", STRING, EPOCH, text(ARM.urdf))
    if how == LACKING:
        effort[0, 2] = np.nan
        return [description, *said(ARM.joints, seen, effort=effort)]
    if how == COMMANDED:
        stamps = (EPOCH + np.round(seen.time * 1e9).astype(np.int64)).tolist()
        columns = [ARM.joints.index(joint) for joint in OTHERS]
        commands = [
            ("/efforts", MULTI_ARRAY, s, command(e[columns])) for s, e in zip(stamps, effort, strict=True)
        ]
        return [description, *commands, *said(ARM.joints, seen, effort=effort)]
    own = {
        "rarely": said([ELBOW], seen, every=25, effort=effort),
        "without effort": said([ELBOW], seen),
        "once": said([ELBOW], seen, every=len(seen)),
    }
    return [description, *said(OTHERS, seen, effort=effort), *own[how]]


def loaded(*words: str) -> tuple[list[Recording], Robot]:
    """What a verb that takes only undisturbed recordings loads."""
    parser = argparse.ArgumentParser()
    options.add_recording_arguments(parser, bags="many")
    recordings, robot = loading.load(parser.parse_args(words), undisturbed=True)
    assert robot is not None
    return recordings, robot


WORDS = {
    LACKING: ["--joints", ",".join(OTHERS)],
    COMMANDED: ["--joints", ",".join(OTHERS), "--effort", "command"],
}


@pytest.mark.parametrize("how", [LACKING, COMMANDED, "rarely", "without effort", "once"])
def test_it_stands_where_any_message_has_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], how: str
) -> None:
    path = write_bag(tmp_path / "bag", told(bent(moves=False), how))
    (recording,), robot = loaded(str(path), *WORDS.get(how, []))
    assert recording.joints == robot.joints == OTHERS
    assert dict(robot.held) == {ELBOW: STANDS}
    assert "held at zero" not in capsys.readouterr().err


@pytest.mark.parametrize("how", [LACKING, COMMANDED, "rarely", "without effort"])
def test_it_is_told_to_move_whoever_tells_where_it_is(tmp_path: Path, how: str) -> None:
    path = write_bag(tmp_path / "bag", told(bent(moves=True), how))
    with pytest.raises(UsageError, match=f"{ELBOW} moves and is left out"):
        loaded(str(path), *WORDS.get(how, []))


def test_one_moves_beside_another_that_is_told_rarely_and_asked_for(tmp_path: Path) -> None:
    seen = bent(moves=True)
    first, last = ARM.joints[:5], ARM.joints[5:]
    messages = [*said(first, seen, effort=seen.effort), *said(last, seen, every=5)]
    path = write_bag(tmp_path / "bag", [("/robot_description", STRING, EPOCH, text(ARM.urdf)), *messages])
    with pytest.raises(UsageError, match=f"{ELBOW} moves and is left out"):
        loaded(str(path), "--joints", ",".join(OTHERS))


def test_positions_are_read_joint_by_joint(tmp_path: Path) -> None:
    seen = bent(moves=True)
    spoilt = seen.position[:, :3].copy()
    spoilt[:, 0], spoilt[5, 1] = np.nan, np.inf
    stamps = (EPOCH + np.round(seen.time * 1e9).astype(np.int64)).tolist()
    stamps[7] = stamps[3]  # late
    messages = [
        ("/joint_states", JOINT_STATE, stamp, joint_state("xyz", row, (), (), stamp))
        for stamp, row in zip(stamps, spoilt, strict=True)
    ]
    path = write_bag(tmp_path / "bag", messages)
    first, second = bags.read_positions(
        path, bags.Selection(rename=["y=b"], joints=["x", "b", "z", "no such"])
    )
    assert (first.joints, second.joints) == (("b",), ("z",))
    kept = np.arange(len(seen)) != 7
    np.testing.assert_array_equal(second.position[:, 0], spoilt[kept, 2])
    np.testing.assert_allclose(second.time, seen.time[kept], atol=1e-9)
    kept[5] = False
    np.testing.assert_array_equal(first.position[:, 0], spoilt[kept, 1])
    assert first.effort is None and first.epoch == EPOCH


def test_a_position_is_of_the_driver_not_of_who_makes_up_more_joints(tmp_path: Path) -> None:
    seen = bent(moves=True)
    idle = replace(
        seen.part(slice(5, None, 10)), joints=("gripper", *ARM.joints[1:]), time=seen.time[5::10] + 0.004
    )
    zeros = said(idle.joints, replace(idle, position=np.zeros_like(idle.position)))
    messages = sorted([*said(ARM.joints, seen, effort=seen.effort), *zeros], key=lambda message: message[2])
    path = write_bag(tmp_path / "bag", messages)
    found = {one.joints: one for one in bags.read_positions(path, bags.Selection(joints=["gripper", ELBOW]))}
    np.testing.assert_array_equal(found[(ELBOW,)].position, seen.position[:, 2:3])
    assert not found[("gripper",)].position.any() and len(found) == 2


def test_another_joint_is_put_beside_by_the_clock_and_turns_on() -> None:
    time = np.arange(0.0, 10.0, 0.01)
    recording = Recording(
        time, ("a",), np.sin(time)[:, None], np.cos(time)[:, None], time[:, None], epoch=EPOCH
    )
    rarely = np.arange(0.0, 7.0, 0.3)
    turned = (2.0 * rarely + np.pi) % (2.0 * np.pi) - np.pi
    other = Recording(rarely, ("b",), turned[:, None], epoch=EPOCH + 10**9)
    both = beside(recording, [other])
    assert both.joints == ("a", "b") and both.velocity is None
    np.testing.assert_array_equal(both.position[:, 0], recording.position[:, 0])
    np.testing.assert_allclose(both.position[:, 1], 2.0 * np.clip(time - 1.0, 0.0, rarely[-1]), atol=1e-9)
    np.testing.assert_array_equal(both.require_effort(), np.column_stack([time, np.zeros(len(time))]))
