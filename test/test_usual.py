"""What is usual of a joint while it moves, and that nothing is made up of joints that move now and then."""

from __future__ import annotations

import numpy as np
import pytest
from live_support import real_robot

from bdnn_ros.effects.bristles import bristle
from bdnn_ros.online.changed.hypotheses import Explanation
from bdnn_ros.online.changed.scene import Kind
from bdnn_ros.online.changed.usual import ENOUGH, Usual
from bdnn_ros.online.learning import Learning
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

SCALE = np.array([10.0, 10.0])
RATE, TURN = 100.0, 8.0
"""Each joint moves for so long, one after the other [s]."""


def chunk(level: float, seed: int = 0) -> np.ndarray:
    return level * np.random.default_rng(seed).standard_normal((100, 2))


def test_of_a_joint_nothing_is_usual_until_it_has_moved_for_some_chunks():
    usual, rests = Usual(SCALE), np.zeros((100, 2), bool)
    rests[:, 1] = True
    for k in range(ENOUGH):
        assert not usual.known.any() and (usual.level > 1e6).all()
        usual.take(chunk(1.0, k), rests)
    assert usual.known.tolist() == [True, False]
    assert usual.level[0] == pytest.approx(1.0, rel=0.4) and usual.level[1] > 1e6
    usual.clear()
    assert not usual.known.any()


def test_what_fast_motion_leaves_is_usual_though_most_motion_is_slow():
    usual, moves = Usual(SCALE), np.zeros((100, 2), bool)
    for k in range(20):
        usual.take(chunk(1.0 if k % 4 == 0 else 0.01, k), moves)
    assert (usual.level > 0.5).all()
    assert (usual.noise < 0.1).all()


@pytest.mark.parametrize(
    ("friction", "negative"),
    [
        ((0.5, 1.0, -3.0), False),
        ((-0.1, 1.0, 0.0), False),
        ((-0.3, 1.0, 0.0), True),
        ((1.0, -2.5, 0.0), True),
    ],
)
def test_friction_that_drives_is_no_change(friction, negative):
    drifted = changed("friction", np.diag([0.1, 1.0, 1.0]) ** 2)
    assert drifted.below_nothing(np.array(friction)) == negative


@pytest.mark.parametrize(("mass", "negative"), [(0.5, False), (-0.1, False), (-0.3, True)])
def test_no_body_weighs_less_than_nothing_after_something_was_released(mass, negative):
    released = changed("payload", 0.1**2 * np.eye(10))
    assert released.below_nothing(np.array([mass, *[-1.0] * 9])) == negative


def changed(kind: Kind, covariance: np.ndarray) -> Explanation:
    """A change as surely known as a covariance says."""
    none = np.zeros(0)
    return Explanation(kind, 0, 0.0, 1.0, 50.0, 1.0, 1.0, none, covariance, none, none)


def in_turn(robot: Robot, friction: np.ndarray) -> Recording:
    """Joint after joint, twice, of a robot whose dry friction comes on over the first milliradians."""
    time = np.arange(round(2 * TURN * robot.width * RATE)) / RATE
    turn = (time // TURN % robot.width)[:, None] == np.arange(robot.width)
    phase = np.pi * (time % TURN)[:, None] / TURN
    swing = np.where(turn, np.sin(phase) ** 2 * np.sin(8.0 * phase), 0.0)
    position = 0.4 * swing + 0.3 * np.cumsum(turn, axis=0) / len(time)
    velocity = np.gradient(position, 1.0 / RATE, axis=0)
    acceleration = np.gradient(velocity, 1.0 / RATE, axis=0)
    effort = robot.inverse_dynamics(position, velocity, acceleration)
    dry = np.stack([bristle(one, 0.005) for one in position.T], axis=1)
    noise = 0.003 * np.abs(effort).max(axis=0) * np.random.default_rng(0).standard_normal(effort.shape)
    return Recording(time, robot.joints, position, None, effort + friction * dry + noise)


@pytest.mark.slow
def test_a_joint_that_moves_for_the_first_time_has_not_changed():
    """What is left of it grows from nothing to something, which is learning: it was told as a push, or negative friction."""
    arm = Robot.bundled("arm6")
    real = real_robot(arm, seed=2)
    recording = in_turn(real, 2.0 * real.coulomb)
    learning, told = Learning(arm), []
    for start in range(0, len(recording), 20):
        rows = slice(start, start + 20)
        for _ in learning.take(recording.time[rows], recording.position[rows], recording.effort[rows]):
            pass
        told += [change.finding["sentence"] for change in learning.changes]
        learning.changes.clear()
    assert told == []


def from_pose_to_pose(robot: Robot, seed: int, step: float = 2.5) -> Recording:
    """One pose after the other, the first joint at first in a small part of its range."""
    generator = np.random.default_rng(seed)
    limit = np.minimum(np.abs([robot.limits.lower, robot.limits.upper]).min(axis=0), 2.5)
    poses = 0.8 * limit * generator.uniform(-1.0, 1.0, (16, robot.width))
    poses[:8, 0] *= 0.2
    s = np.arange(0.0, 1.0, 1.0 / (step * RATE))[:, None]
    way = np.diff(poses, axis=0)[:, None]
    parts = (
        poses[:-1, None] + (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5) * way,
        (30.0 * s**2 - 60.0 * s**3 + 30.0 * s**4) * way / step,
        (60.0 * s - 180.0 * s**2 + 120.0 * s**3) * way / step**2,
    )
    position, velocity, acceleration = (part.reshape(-1, robot.width) for part in parts)
    effort = robot.inverse_dynamics(position, velocity, acceleration)
    effort = effort + 0.003 * effort.std(axis=0) * generator.standard_normal(effort.shape)
    return Recording(np.arange(len(position)) / RATE, robot.joints, position, None, effort)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_robot_on_a_tilted_base_picks_nothing_up_in_new_poses(seed):
    """Bodies that make up for the tilt in some poses are wrong in others: a load was told, or friction that drives."""
    arm = Robot.bundled("arm6")
    tilt = np.radians([(-4.0, 3.5), (3.0, 5.0)][seed])
    recording = from_pose_to_pose(real_robot(arm).tilted(*tilt), seed)
    learning = Learning(arm)
    versions = list(learning.take(recording.time, recording.position, recording.effort))
    assert [change.finding["sentence"] for change in learning.changes] == []
    np.testing.assert_allclose(versions[-1].model.tilt, tilt, atol=np.radians(0.05))
    resumed = Learning(arm, resume=versions[-1].model)
    (first, *_) = resumed.take(*(x[:800] for x in (recording.time, recording.position, recording.effort)))
    np.testing.assert_allclose(first.model.tilt, tilt, atol=np.radians(0.05))
