"""A bag is read for the joints of the robot, wherever that one is known from."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from bag_cases import (
    EPOCH,
    JOINT_STATE,
    MULTI_ARRAY,
    STRING,
    Message,
    command,
    joint_state,
    motion,
    text,
    write_bag,
)

from bdnn_ros import bags
from bdnn_ros.cli import loading, options
from bdnn_ros.models import Model
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm6")
SEEN = motion(200, joints=ARM.joints)
STAMPS = (EPOCH + np.round(SEEN.time * 1e9).astype(np.int64)).tolist()
DESCRIPTION = ("/robot_description", STRING, EPOCH - 1000, text(ARM.urdf))


def said(joints: Sequence[str], late: int = 0, gripper: Sequence[float] = ()) -> list[Message]:
    """Joint states of some joints in this order, so late [ns], and of a gripper that is somewhere."""
    moved, names = SEEN.select(joints), [*joints, "gripper"][: len(joints) + len(gripper)]
    rows = zip(STAMPS, moved.position, moved.require_effort(), strict=True)
    return [
        (
            "/joint_states",
            JOINT_STATE,
            stamp + late,
            joint_state(names, [*q, *gripper], (), [*u, *gripper], stamp + late),
        )
        for stamp, q, u in rows
    ]


def turned_round(late: int = 0) -> list[Message]:
    """Joint states from the tip, commands from the base, so late [ns]."""
    commands = [
        ("/efforts", MULTI_ARRAY, s + late - 1, command(e))
        for s, e in zip(STAMPS, SEEN.require_effort(), strict=True)
    ]
    states = said(ARM.joints[::-1], late)
    return [message for pair in zip(commands, states, strict=True) for message in pair]


def loaded(words: Sequence[str | Path], model: Robot | None = None) -> list[Recording]:
    """What a verb loads that needs no description."""
    parser = argparse.ArgumentParser()
    options.add_recording_arguments(parser, bags="many")
    args = parser.parse_args(list(map(str, words)))
    recordings, _ = loading.load(args, model=cast(Model, model), needs_robot=False)
    return recordings


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A bag without a description."""
    return write_bag(tmp_path / "bag", turned_round())


@pytest.mark.parametrize(
    "known", ["--urdf", "--robot", "before it", "behind it", "a model", "a model of some"]
)
def test_commands_are_in_the_robots_order(tmp_path: Path, bag: Path, known: str) -> None:
    (tmp_path / "arm.urdf").write_text(ARM.urdf)
    other = write_bag(tmp_path / "described", [DESCRIPTION, *turned_round(late=10**10)])
    words = {
        "--urdf": [bag, "--urdf", tmp_path / "arm.urdf"],
        "--robot": [bag, "--robot", "arm6"],
        "before it": [other, bag],
        "behind it": [bag, other],
    }
    some = {"a model": ARM.joints, "a model of some": ARM.joints[1:4]}.get(known)
    model = Robot.from_urdf(ARM.urdf, some) if some else None
    for recording in loaded([*words.get(known, [bag]), "--effort", "command"], model):
        assert recording.joints == (some or ARM.joints)
        np.testing.assert_array_equal(recording.effort, SEEN.select(recording.joints).effort)


@pytest.mark.parametrize("gripper", [(), (0.02,)], ids=["commanded alone", "in the joint states"])
@pytest.mark.parametrize("described", [True, False])
def test_what_is_commanded_beside_the_arm_keeps_its_place(
    tmp_path: Path, gripper: tuple[float, ...], described: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    sent = [
        ("/efforts", MULTI_ARRAY, stamp - 1, command([*u[:2], 7.0, *u[2:]]))
        for stamp, u in zip(STAMPS, SEEN.require_effort(), strict=True)
    ]
    messages = sorted([*said(ARM.joints, gripper=gripper), *sent], key=lambda message: message[2])
    path = write_bag(tmp_path / "bag", [DESCRIPTION, *messages] if described else messages)
    named = [*ARM.joints[:2], "gripper", *ARM.joints[2:]]
    (recording,) = loaded([path, "--effort", "command", "--joints", ",".join(named)])
    assert recording.joints == (ARM.joints if described or not gripper else tuple(named))
    np.testing.assert_array_equal(
        recording.select(ARM.joints).require_effort(), SEEN.select(ARM.joints).require_effort()
    )
    told = "gripper only stands for what the commands hold" in capsys.readouterr().err
    assert told == ("gripper" not in recording.joints)


def test_a_prediction_is_for_commands_in_the_models_order(bag: Path) -> None:
    parser = argparse.ArgumentParser()
    options.add_recording_arguments(parser, bags="one")
    some = Robot.from_urdf(ARM.urdf, ARM.joints[1:4])
    every = loading.load_every(parser.parse_args([str(bag), "--effort", "command"]), cast(Model, some))
    np.testing.assert_array_equal(every.effort, SEEN.select(some.joints).effort)


def test_joints_in_messages_of_their_own_are_put_together(tmp_path: Path) -> None:
    first, last = said(ARM.joints[:3]), said(ARM.joints[3:], late=3_000_000)
    path = write_bag(tmp_path / "bag", sorted([*first, *last], key=lambda message: message[2]))
    (recording,) = loaded([path, "--robot", "arm6"])
    assert recording.joints == ARM.joints


def test_a_gripper_that_nobody_asks_for_may_be_nowhere(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", said(ARM.joints, gripper=[np.nan]))
    (recording,) = loaded([path, "--robot", "arm6"])
    assert recording.joints == ARM.joints


def test_a_description_is_read_alone(tmp_path: Path, bag: Path) -> None:
    empty = (DESCRIPTION[0], STRING, EPOCH, text(""))
    theirs = ("/left/robot_description", STRING, EPOCH, text("<robot/>"))
    states = said(ARM.joints)
    for name, messages, topic, told in (
        ("said again", [DESCRIPTION, empty], "/joint_states", ARM.urdf),
        ("empty", [empty], "/joint_states", ""),
        ("another", [DESCRIPTION, theirs], "/joint_states", ARM.urdf),
        ("theirs", [DESCRIPTION, theirs], "/left/joint_states", "<robot/>"),
    ):
        path = write_bag(tmp_path / name, [*messages, *((topic, *state[1:]) for state in states)])
        assert bags.read_description(path, topic) == bags.read(path, bags.Selection(topic)).urdf == told
    assert bags.read_description(bag) is None
