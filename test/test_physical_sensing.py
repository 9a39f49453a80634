"""Noise of the sensors behind the low-pass, against noise that is really low-passed."""

import numpy as np
import pytest

from bdnn_ros.physical.columns import smooth_columns, tilting
from bdnn_ros.physical.sensing import SensorNoise
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare

RATE = 500.0
POSITION_NOISE, EFFORT_NOISE = 1e-4, np.array([0.3, 0.1])


def noisy(seconds=200.0):
    """Signals of two joints that swing, with white noise, and the same without."""
    rng, robot = np.random.default_rng(0), Robot.bundled("arm2")
    time = np.arange(0.0, seconds, 1.0 / RATE)
    position = np.stack([np.sin(2.0 * time), np.cos(1.3 * time)], axis=1)
    still = np.zeros_like(position)
    effort = EFFORT_NOISE * rng.normal(size=position.shape)
    seen = position + POSITION_NOISE * rng.normal(size=position.shape)
    loud, quiet = (
        prepare(Recording(time, robot.joints, q, None, tau)) for q, tau in ((seen, effort), (position, still))
    )
    return robot, loud, quiet


@pytest.fixture(scope="module")
def made():
    robot, loud, quiet = noisy()
    rows = np.flatnonzero(loud.interior)[::4]
    return robot, loud, quiet, rows, SensorNoise.of(robot, loud, rows)


def test_noise_of_the_effort_is_what_passes_the_low_pass(made):
    _, loud, _, rows, noise = made
    left = loud.smooth(loud.effort)[rows]
    np.testing.assert_allclose(noise.effort / noise.count, left.var(axis=0), rtol=0.1)
    # rows that count as one: how much more the mean of many rows scatters than that of independent ones
    many = 50
    means = left[: len(left) // many * many].reshape(-1, many, 2).mean(axis=1)
    np.testing.assert_allclose(
        noise.alike / noise.effort, many * means.var(axis=0) / left.var(axis=0), rtol=0.4
    )


def test_noise_of_the_position_reaches_the_effort_through_the_acceleration(made):
    robot, loud, quiet, rows, noise = made
    x = np.append(robot.inertials.ravel(), 0.2)
    robot = robot.with_joint_parameters(np.full(2, 0.2), np.zeros(2), np.zeros(2))
    clean, felt = (
        s.smooth(robot.rigid_effort(s.position, s.velocity, s.acceleration) + 0.2 * s.acceleration)[rows]
        for s in (quiet, loud)
    )
    ours = [noise.variance(joint, x) - noise.effort[joint] / noise.count for joint in range(2)]
    np.testing.assert_allclose(ours, np.var(felt - clean, axis=0), rtol=0.15)


def test_what_the_sensors_do_not_explain_counts_for_less(made):
    robot, _, _, _, noise = made
    x = np.append(robot.inertials.ravel(), 0.0)
    least = noise.variance(0, x)
    alone, more, most = (noise.correlation(0, x, factor * least, 8.0) for factor in (1.0, 2.0, 1000.0))
    assert 1.0 <= alone <= noise.alike[0] / noise.effort[0]
    assert alone < more < most < 8.0
    assert most == pytest.approx(8.0, rel=0.01)
    # less than the sensors' noise is chance
    assert noise.correlation(0, x, 0.5 * least, 8.0) == pytest.approx(alone)


def test_noise_of_two_chunks_adds_up(made):
    robot, loud, _, rows, noise = made
    half = len(rows) // 2
    both = SensorNoise.of(robot, loud, rows[:half]) + SensorNoise.of(robot, loud, rows[half:])
    assert both.count == noise.count
    np.testing.assert_allclose(both.effort, noise.effort)
    np.testing.assert_allclose(both.alike, noise.alike, rtol=1e-2)


def test_a_joint_that_turns_round_accelerates_and_one_that_stands_shows_noise():
    robot, time = Robot.bundled("arm2"), np.arange(0.0, 12.0, 0.01)
    swing = 0.5 * np.cos(np.minimum(1.2 * time, 2.0 * np.pi))
    position = np.stack([swing, 0.3 * np.sin(time)], axis=1)
    position += 2e-4 * np.random.default_rng(0).normal(size=position.shape)
    signals = prepare(Recording(time, robot.joints, position, None, np.zeros_like(position)))
    turns = np.abs(signals.time - np.pi / 1.2) < 0.02
    stands = signals.time > 2.0 * np.pi / 1.2 + 0.3
    assert signals.at_rest[turns, 0].any() and signals.standing[stands, 0].mean() > 0.99
    own = smooth_columns(robot, signals, tilting(robot))[:, 0, robot.inertials.size]
    np.testing.assert_array_equal(own[turns], signals.acceleration[turns, 0])
    assert np.mean(own[stands] == 0.0) > 0.99
