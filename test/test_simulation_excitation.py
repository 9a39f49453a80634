"""Motions keep every limit, start from rest, and are as rich or as poor as asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros.errors import UsageError
from bdnn_ros.physical.parameters import usual_motion
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import ACCELERATION_PER_VELOCITY, fourier, poor

ROBOTS = ("arm2", "arm6", "arm7")
TIME = np.arange(4000) / 200.0


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("seed", range(3))
def test_a_fourier_motion_keeps_all_limits(name, seed):
    robot = Robot.bundled(name)
    motion = fourier(robot, TIME, np.random.default_rng(seed))
    limits = robot.limits
    assert (motion.position > limits.lower).all()
    assert (motion.position < limits.upper).all()
    assert (np.abs(motion.velocity) < limits.velocity).all()
    assert (np.abs(motion.acceleration) < ACCELERATION_PER_VELOCITY * limits.velocity).all()
    effort = robot.inverse_dynamics(motion.position, motion.velocity, motion.acceleration)
    assert (np.abs(effort) < 0.8 * limits.effort).all()


@pytest.mark.parametrize("name", ["arm2", "arm6"])
@pytest.mark.parametrize("duration", [500.0, 1000.0])
def test_a_long_motion_keeps_its_limits_too(name, duration):
    """It was looked at every two seconds, at the same ten moments of each period."""
    robot = Robot.bundled(name)
    for seed in range(3):
        rng = np.random.default_rng([seed, *b"motion"])
        motion = fourier(robot, np.arange(round(50.0 * duration)) / 50.0, rng)
        limits = robot.limits
        assert (motion.position > limits.lower).all() and (motion.position < limits.upper).all()
        assert (np.abs(motion.velocity) < 0.8 * limits.velocity).all()


@pytest.mark.parametrize("make", [fourier, poor])
def test_velocity_and_acceleration_are_the_positions_derivatives(make):
    robot = Robot.bundled("arm6")
    motion = make(robot, TIME, np.random.default_rng(5))
    step = TIME[1]
    assert np.gradient(motion.position, step, axis=0)[1:-1] == pytest.approx(motion.velocity[1:-1], abs=2e-3)
    assert np.gradient(motion.velocity, step, axis=0)[1:-1] == pytest.approx(
        motion.acceleration[1:-1],
        abs=4e-2,  # the jerk steps where the swelling ends
    )


@pytest.mark.parametrize("make", [fourier, poor])
def test_a_motion_starts_smoothly_from_rest(make):
    motion = make(Robot.bundled("arm7"), TIME, np.random.default_rng(1))
    assert (motion.velocity[0] == 0.0).all()
    assert (motion.acceleration[0] == 0.0).all()
    assert np.abs(np.diff(motion.acceleration, axis=0)).max() < 0.6


def test_every_joint_moves_and_turns():
    motion = fourier(Robot.bundled("arm7"), TIME, np.random.default_rng(2))
    reversals = np.sum(np.diff(np.sign(motion.velocity[1:]), axis=0) != 0, axis=0)
    assert (reversals >= 8).all()
    assert (np.ptp(motion.position, axis=0) > 0.5).all()


def test_a_poor_motion_is_one_joint_slow_and_small():
    motion = poor(Robot.bundled("arm7"), TIME, np.random.default_rng(0), joint=3)
    moving = np.ptp(motion.position, axis=0) > 0.0
    assert moving.tolist() == [False, False, False, True, False, False, False]
    assert np.ptp(motion.position[:, 3]) < 0.35
    assert np.abs(motion.velocity).max() < 0.15


def test_the_same_seed_moves_alike_and_another_does_not():
    robot = Robot.bundled("arm2")
    first, again, other = (fourier(robot, TIME, np.random.default_rng(s)).position for s in (4, 4, 5))
    assert (first == again).all()
    assert np.abs(first - other).max() > 0.1


@pytest.mark.slow
def test_an_arm_that_cannot_hold_itself_is_refused():
    robot = Robot.bundled("arm7")
    weak = replace(robot, limits=replace(robot.limits, effort=np.full(7, 0.5)))
    with pytest.raises(UsageError, match="effort limits"):
        fourier(weak, TIME, np.random.default_rng(0))


def test_joints_without_limits_move_within_a_half_turn():
    robot = Robot.bundled("arm2")
    endless = np.full(2, np.inf)
    free = replace(robot, limits=replace(robot.limits, lower=-endless, upper=endless, velocity=endless))
    motion = fourier(free, TIME, np.random.default_rng(0))
    assert np.abs(motion.position).max() < np.pi
    assert np.abs(motion.velocity).max() < 2.0


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ((-2.0, 1.0), (-2.0, 1.0)),
        ((-9.0, 1.0), (-np.pi, 1.0)),
        ((0.0, 8.0), (0.0, np.pi)),
        ((3.3, 6.0), (3.3, 6.0)),
        ((4.0, 14.0), (9.0 - np.pi, 9.0 + np.pi)),
        ((-8.0, -4.0), (-8.0, -4.0)),
        ((4.0, np.inf), (4.0, 4.0 + 2.0 * np.pi)),
        ((-np.inf, -4.0), (-4.0 - 2.0 * np.pi, -4.0)),
    ],
)
def test_limits_beyond_a_half_turn_leave_room(limits, expected):
    """As a rail has that begins somewhere in the hall."""
    robot = Robot.bundled("arm2")
    lower, upper = np.array([limits, (-1.0, 1.0)]).T
    robot = replace(robot, limits=replace(robot.limits, lower=lower, upper=upper))
    low, high = robot.limits.usual_range
    assert (low[0], high[0]) == pytest.approx(expected)
    assert (low[1], high[1]) == (-1.0, 1.0)
    motion = fourier(robot, TIME, np.random.default_rng(0)).position
    assert (motion > low).all() and (motion < high).all()
    position = usual_motion(robot)[0]
    assert (position >= low).all() and (position <= high).all()
    assert (np.ptp(position, axis=0) > 0.9 * (high - low)).all()
