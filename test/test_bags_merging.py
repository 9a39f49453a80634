"""Joints that come in messages of their own: put together by their stamps, or left out with the reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bag_cases import MULTI_ARRAY, Message, command, motion, states, write_bag

from bdnn_ros import bags
from bdnn_ros.errors import BagError
from bdnn_ros.recording import Recording
from bdnn_ros.signals import prepare

SIX = ("a", "b", "c", "d", "e", "f")
WHOLE = motion(joints=SIX)


def smooth(time: np.ndarray, joints: Sequence[str]) -> Recording:
    """Joints of the same motion at any times, with an effort as smooth."""
    columns = np.array([SIX.index(joint) for joint in joints])
    position = np.sin(2.0 * time[:, None] + columns)
    velocity = 2.0 * np.cos(2.0 * time[:, None] + columns)
    return replace(
        WHOLE, time=time, joints=tuple(joints), position=position, velocity=velocity, effort=3.0 * position
    )


def bag(path: Path, *parts: Recording, more: Sequence[Message] = ()) -> Path:
    """The joint states of several publishers, in the order in which they were sent."""
    messages = [message for part in parts for message in states(part)]
    return write_bag(path / "bag", sorted([*messages, *more], key=lambda message: message[2]))


def test_messages_of_the_same_stamp_become_one_sample(tmp_path: Path) -> None:
    path = bag(tmp_path, WHOLE.select(["a", "b", "c"]), WHOLE.select(["f", "e", "d"]))
    again = bags.read(path, bags.Selection(robot_joints=[*SIX, "g"]))
    assert again.joints == SIX
    for field in ("position", "velocity", "effort"):
        np.testing.assert_array_equal(getattr(again, field), getattr(WHOLE, field))
    assert len(again.notes) == 1
    assert (
        "messages of their own hold d, e, f; they are put to the others of the same stamp" in again.notes[0]
    )
    assert bags.read(path, bags.Selection(joints=["d", "a"])).joints == ("d", "a")


@pytest.mark.parametrize("rate", [100.0, 60.0])
def test_streams_that_are_not_synchronous_are_interpolated(tmp_path: Path, rate: float) -> None:
    first = smooth(WHOLE.time, SIX[:3])
    second = smooth(np.arange(0.004, 6.0, 1.0 / rate), SIX[3:])
    again = bags.read(bag(tmp_path, first, second), bags.Selection(robot_joints=SIX))
    expected = smooth(again.time + 1e-9 * (again.epoch - WHOLE.epoch), SIX)
    assert len(again) >= 597
    for field in ("position", "velocity", "effort"):
        np.testing.assert_allclose(getattr(again, field), getattr(expected, field), atol=2e-3)
    assert f"from {rate:g} Hz they are interpolated" in again.notes[0]
    assert "have no others beside them; left out" in again.notes[1]


def test_a_wheel_that_is_told_within_one_turn_goes_on_between_its_samples(tmp_path: Path) -> None:
    time = WHOLE.time + 0.004
    position = (2.0 * time[:, None] + np.pi) % (2.0 * np.pi) - np.pi
    wheel = replace(smooth(time, ["f"]), position=position, velocity=None)
    again = bags.read(bag(tmp_path, smooth(WHOLE.time, SIX[:5]), wheel), bags.Selection(robot_joints=SIX))
    signals = prepare(again)
    np.testing.assert_allclose(signals.velocity[:, 5], 2.0, atol=1e-3)
    np.testing.assert_allclose(signals.acceleration[:, 5], 0.0, atol=0.1)
    assert again.velocity is not None
    np.testing.assert_allclose(again.velocity[:, 5], 2.0, atol=1e-3)


def test_nothing_is_interpolated_over_a_gap(tmp_path: Path) -> None:
    second = smooth(WHOLE.time + 0.003, SIX[3:])
    second = second.part((second.time < 2.0) | (second.time > 3.0))
    again = bags.read(bag(tmp_path, smooth(WHOLE.time, SIX[:3]), second), bags.Selection(robot_joints=SIX))
    pieces = again.segments()
    assert len(pieces) == 2
    assert again.time[pieces[1].start] - again.time[pieces[0].stop - 1] == pytest.approx(1.0, abs=0.03)


def test_clocks_that_are_set_back_together_are_followed(tmp_path: Path) -> None:
    messages = []
    for start, back in ((0, 0), (300, 5 * 10**9)):
        later = replace(WHOLE.part(slice(start, start + 300)), epoch=WHOLE.epoch - back)
        for pair in zip(states(later.select(SIX[:3])), states(later.select(SIX[3:])), strict=True):
            messages += [(t, k, log + back, data) for t, k, log, data in pair]
    again = bags.read(
        write_bag(tmp_path / "bag", messages), bags.Selection(robot_joints=SIX), drop_invalid=True
    )
    np.testing.assert_array_equal(again.effort, WHOLE.effort)
    assert again.segments() == [slice(0, 300), slice(300, 600)]


@pytest.mark.parametrize(
    ("gripper", "reason"),
    [
        (replace(WHOLE.select(["f"]), effort=None), "without effort"),
        (WHOLE.select(["f"]).part(slice(0, None, 20)), "too rarely (5 Hz)"),
        (replace(WHOLE.select(["f"]), time=WHOLE.time + 4.0), "at other times"),
    ],
)
def test_a_gripper_that_does_not_fit_stays_out(tmp_path: Path, gripper: Recording, reason: str) -> None:
    arm = WHOLE.select(SIX[:5])
    again = bags.read(bag(tmp_path, arm, gripper), bags.Selection(robot_joints=SIX))
    np.testing.assert_array_equal(again.effort, arm.effort)
    assert again.joints == arm.joints
    (note,) = again.notes
    assert f"messages of their own hold f, {reason}; left out" in note


def test_joints_that_are_asked_for_are_put_together_or_refused(tmp_path: Path) -> None:
    silent = replace(WHOLE.select(["f"]), effort=None)
    again = bags.read(bag(tmp_path / "silent", WHOLE.select(SIX[:5]), silent), bags.Selection(joints=SIX))
    assert again.joints == SIX
    late = replace(WHOLE.select(["f"]), time=WHOLE.time + 60.0)
    path = bag(tmp_path / "late", WHOLE.select(SIX[:5]), late)
    with pytest.raises(
        BagError, match=r"no message holds a, f together, and those that hold f come at other times"
    ):
        bags.read(path, bags.Selection(joints=["a", "f"]))


def test_commands_may_stand_for_joints_of_several_messages(tmp_path: Path) -> None:
    sent = [("/u", MULTI_ARRAY, WHOLE.epoch, command(np.arange(6.0)))]
    path = bag(tmp_path, WHOLE.select(SIX[:3]), WHOLE.select(SIX[3:]), more=sent)
    again = bags.read(path, bags.Selection(effort="command", robot_joints=SIX))
    np.testing.assert_array_equal(again.effort[0], np.arange(6.0))
    fewer = [("/u", MULTI_ARRAY, WHOLE.epoch, command(np.arange(5.0)))]
    path = bag(tmp_path / "fewer", WHOLE.select(SIX[:5]), WHOLE.select(SIX[5:]), more=fewer)
    assert bags.read(path, bags.Selection(effort="command", robot_joints=SIX)).joints == SIX[:5]


def test_controllers_that_take_turns_are_not_put_together(tmp_path: Path) -> None:
    """Each is there for half of the samples, and none of these has them all."""
    half = len(WHOLE) // 2
    turns = [WHOLE.select(SIX[2:4]).part(slice(half)), WHOLE.select(SIX[4:]).part(slice(half, None))]
    path = bag(tmp_path, WHOLE.select(SIX[:2]), *turns)
    again = bags.read(path, bags.Selection(robot_joints=SIX))
    assert (again.joints, len(again)) == (SIX[:4], half)
    said = "messages of their own hold e, f, at other times than those of c, d; left out."
    assert any(said in note for note in again.notes)
    with pytest.raises(
        BagError, match=r"those that hold e, f come at other times than those of c, d\. .*--joints"
    ):
        bags.read(path, bags.Selection(joints=SIX))
