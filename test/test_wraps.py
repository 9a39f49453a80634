"""Angles recorded within one turn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals.wraps import between, without_wraps
from bdnn_ros.simulation.simulate import simulate


def turning() -> Recording:
    """A joint that turns on and one that swings."""
    time = np.arange(2000) / 100.0
    return Recording(time, ("a", "b"), np.stack([3.0 * time, 2.0 * np.sin(time)], axis=1))


def wrapped(recording: Recording, centre: float = 0.0) -> Recording:
    turns = np.round((recording.position - centre) / (2.0 * np.pi))
    return replace(recording, position=recording.position - 2.0 * np.pi * turns)


def test_turns_are_put_back_and_told():
    recording = turning()
    again = without_wraps(wrapped(recording))
    np.testing.assert_allclose(again.position, recording.position, atol=1e-9)
    assert again.notes == (
        "recording: the position of a was recorded within one turn; 10 jumps are put back.",
    )


def test_in_a_pause_a_joint_may_go_as_far_as_a_turn():
    """Or a slide as many metres."""
    recording = turning()
    later = np.arange(len(recording)) >= 1000
    paused = replace(
        recording,
        time=recording.time + 20.0 * later,
        position=np.sin(recording.time)[:, None] + 2.0 * np.pi * later[:, None] * np.ones(2),
    )
    assert without_wraps(paused) is paused


def test_what_does_not_jump_by_whole_turns_is_kept():
    recording = turning()
    stepping = recording.position.copy()
    stepping[1000:] += 4.0
    for kept in (
        recording,
        replace(recording, position=stepping),
        *(recording.part(slice(0, k)) for k in (0, 1)),
    ):
        assert without_wraps(kept) is kept


@pytest.fixture(scope="module")
def crossing() -> tuple[Robot, Recording, Recording]:
    """An arm with friction, as it moved and as a driver tells it that cuts in the middle of the motion."""
    robot = Robot.bundled("arm2")
    spec = parse_spec("coulomb_friction@arm2_joint1:coulomb=2.0", robot)
    recording = simulate(robot, [spec], seed=3, duration=20.0).recording
    return robot, recording, wrapped(recording, np.pi + np.median(recording.position, axis=0))


@pytest.mark.slow
def test_a_diagnosis_names_the_same(crossing):
    robot, recording, cut = crossing
    before, after = diagnose([recording], robot), diagnose([cut], robot)
    assert [(f.effect, f.joint) for f in after.findings] == [("coulomb_friction", "arm2_joint1")]
    assert after.findings[0].parameters["coulomb"].value == pytest.approx(
        before.findings[0].parameters["coulomb"].value, rel=1e-3
    )


@pytest.mark.slow
def test_so_does_what_is_identified_live(crossing):
    robot, recording, cut = crossing
    models = [Identifier(robot).fit([one]) for one in (recording, cut)]
    np.testing.assert_allclose(models[1].robot.inertials, models[0].robot.inertials, rtol=0.02, atol=2e-3)


def test_what_covers_more_than_a_turn_was_not_recorded_within_one():
    """Degrees at a low rate, and millimetres of a slide, step by about six now and then."""
    time = np.arange(500) / 25.0
    quick = np.stack([80.0 * np.sin(2.0 * time), 300.0 * np.cos(0.5 * time)], axis=1)
    assert (np.abs(np.diff(quick, axis=0)) > 5.0).any(axis=0).all()
    recording = Recording(time, ("degrees", "millimetres"), quick)
    assert without_wraps(recording) is recording


def test_noise_and_a_wrong_reading_do_not_hide_a_turn():
    recording = turning()
    told = wrapped(recording).position + np.random.default_rng(0).normal(0.0, 0.01, recording.position.shape)
    told[700, 0] = 50.0
    again = without_wraps(replace(recording, position=told)).position
    assert np.abs(np.delete(again - recording.position, 700, axis=0)).max() < 0.1


@pytest.mark.parametrize("lowest", [-np.pi, 0.0])
@pytest.mark.parametrize("speed", [2.0, -9.0])
def test_between_two_samples_a_joint_goes_on_not_back_through_its_turn(lowest, speed):
    time = np.arange(0.0, 20.0, 0.05)
    true = np.stack([speed * time, np.sin(time)], axis=1)
    position = np.stack([(true[:, 0] - lowest) % (2.0 * np.pi) + lowest, true[:, 1]], axis=1)
    share = np.random.default_rng(0).uniform(0.0, 1.0, (len(time) - 1, 1))
    seen = np.where(np.arange(len(time))[:, None] == 7, np.nan, position)
    found = between(seen[:-1], seen[1:], share, seen)
    known = np.isfinite(found[:, 0])
    assert known.sum() == len(time) - 3
    expected = true[:-1] + share * np.diff(true, axis=0)
    turns = (found - expected)[known] / (2.0 * np.pi)
    np.testing.assert_allclose(turns[:, 0], np.round(turns[:, 0]), atol=1e-9)
    np.testing.assert_allclose(turns[:, 1], 0.0, atol=1e-9)
    assert found[known, 0].min() > lowest - 0.1 and found[known, 0].max() < lowest + 2.0 * np.pi + 0.1


def test_a_quick_slide_is_no_turn():
    """What goes on further than a turn was not recorded within one."""
    slide = np.arange(10.0)[:, None] * 2.0 * np.pi
    found = between(slide[:-1], slide[1:], np.full((9, 1), 0.5), slide)
    np.testing.assert_allclose(found, slide[:-1] + np.pi)
