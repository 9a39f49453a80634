"""A robot on its brakes: no effort acts though its links weigh on it, which says nothing of them, and is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros.checks.efforts import braked, unread
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.online.learning import Learning
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare
from bdnn_ros.signals.powerless import powerless

RATE, ENDS = 125.0, 30.0
STOP, START = 10.0, 20.0
"""The arm comes to rest and moves on [s]; a second after, and before, it is on its brakes."""
NOISE = 0.02


@pytest.fixture(scope="module")
def arm() -> Robot:
    return Robot.bundled("arm2")


def stopping(arm: Robot) -> Recording:
    """A motion with a long rest, and efforts as described and noise."""
    time = np.arange(0.0, ENDS, 1.0 / RATE)
    pace = 1.0 - np.clip((time - STOP) / 0.4, 0, 1) + np.clip((time - START) / 0.4, 0, 1)
    pace = pace**3 * (10.0 - 15.0 * pace + 6.0 * pace**2)
    phase = np.cumsum(pace)[:, None] / RATE
    waves = np.array([[2.3, 1.1, 3.7], [1.7, 2.9, 0.9]]).T[:, None, :]
    position = np.sum(0.3 * np.sin(waves * phase + np.arange(3)[:, None, None]), axis=0)
    velocity = np.gradient(position, 1.0 / RATE, axis=0)
    effort = arm.rigid_effort(position, velocity, np.gradient(velocity, 1.0 / RATE, axis=0))
    effort += arm.viscous * velocity + arm.coulomb * np.tanh(velocity / 0.01)
    noise = NOISE * np.random.default_rng(0).standard_normal(effort.shape)
    return Recording(time, arm.joints, position, None, effort + noise)


def on_its_brakes(recording: Recording, level: np.ndarray | float = 0.0) -> Recording:
    stands = (recording.time > STOP + 1.0) & (recording.time < START - 1.0)
    steps = np.random.default_rng(1).integers(-1, 2, recording.position.shape) * NOISE
    effort = np.where(stands[:, None], level + np.round(steps, 3), recording.require_effort())
    return replace(recording, effort=effort)


def test_efforts_of_nothing_while_all_joints_stand_are_found(arm):
    resting = stopping(arm)
    assert not powerless(resting).any()
    found = powerless(on_its_brakes(resting))
    time = resting.time
    assert found[(time > STOP + 1.0) & (time < START - 1.0)].all()
    assert not found[(time < STOP + 0.8) | (time > START - 0.8)].any()


def test_a_joint_that_is_held_is_not_without_an_effort(arm):
    assert not powerless(on_its_brakes(stopping(arm), np.array([0.0, 5.0]))).any()


def test_it_is_told_once_and_only_where_links_weigh(arm):
    resting = on_its_brakes(stopping(arm))
    (remark,) = (*unread(resting), *braked(resting, arm))
    assert "for 8" in remark.problem and "brakes" in remark.remedy
    assert not list(braked(resting, replace(arm, gravity_vector=np.zeros(3))))


def test_what_is_identified_does_not_feel_it(arm):
    resting = stopping(arm)
    wrong = arm.with_inertials(1.1 * arm.inertials)
    plain, braking = (Identifier(wrong).fit([one]) for one in (resting, on_its_brakes(resting)))
    signals = prepare(resting)
    error = [np.std(model.predict(signals) - signals.effort, axis=0) for model in (plain, braking)]
    np.testing.assert_allclose(error[1], error[0], rtol=0.1)


def test_a_stream_goes_on_as_if_nothing_had_been(arm):
    resting = on_its_brakes(stopping(arm))
    learning = Learning(arm.with_inertials(1.1 * arm.inertials))
    for _ in learning.take(resting.time, resting.position, resting.require_effort()):
        pass
    assert not learning.changes and not learning.rejected
    assert not [one for one in learning.errors if STOP + 2.0 < one.time < START - 1.0]
    last = learning.errors[-1]
    assert (last.squared < 0.01 * last.variance).all()
