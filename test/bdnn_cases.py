"""Small robots and motions for the tests of the BDNN."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.bdnn.cores import NetworkCore
from bdnn_ros.bdnn.dynamics import BDNN
from bdnn_ros.bdnn.field import Field, Scales
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals, prepare


def scales(n: int) -> Scales:
    """Sizes that differ by joint."""
    falling = np.linspace(1.0, 0.2, n)
    return Scales(1.0 + falling, 5.0 * (2.0 - falling), 20.0 * falling**2, 0.1 * falling)


def random_field(n: int, hidden: int = 8, seed: int = 0, size: float = 0.3) -> Field:
    """Networks whose weights have been shaken."""
    rng = np.random.default_rng(seed)
    field = Field.random(scales(n), hidden, rng)
    return field.with_vector(field.vector() + size * rng.normal(size=field.vector().size))


def black_box(
    joints: Sequence[str], sizes: Scales, hidden: int = 64, seed: int = 0, activation: str = "tanh"
) -> BDNN:
    """Untrained networks, as in the paper: one hidden layer each for H and R."""
    field = Field.random(sizes, hidden, np.random.default_rng(seed), activation)
    return BDNN(NetworkCore(tuple(joints), field))


def worn(name: str) -> Robot:
    """A bundled robot with rotors and friction."""
    robot = Robot.bundled(name)
    usual = np.where(np.isfinite(robot.limits.effort), robot.limits.effort, 50.0)
    return robot.with_joint_parameters(0.002 * usual, 0.01 * usual, 0.01 * usual)


def wave(robot: Robot, seconds: float, seed: int, rate: float = 250.0) -> tuple[np.ndarray, ...]:
    """Time, position, velocity, acceleration of a random Fourier motion of a robot of any joints."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(seconds * rate)) / rate
    frequency = 2.0 * np.pi * np.array([0.11, 0.23, 0.37, 0.53, 0.71])
    amplitude = rng.uniform(0.2, 0.5, (robot.width, 5)) / np.sqrt(np.arange(1, 6))
    angle = frequency * time[:, None, None] + rng.uniform(0.0, 6.28, (robot.width, 5))
    centre = rng.uniform(-0.5, 0.5, robot.width)
    position = centre + (amplitude * np.sin(angle)).sum(2)
    velocity = (amplitude * frequency * np.cos(angle)).sum(2)
    return time, position, velocity, -(amplitude * frequency**2 * np.sin(angle)).sum(2)


def signals(robot: Robot, seconds: float, seed: int, noise: float = 0.002, extra: object = None) -> Signals:
    """Signals of a robot along a motion, with noise on position and effort.

    Args:
        noise: of the effort, as a share of its range.
        extra: a further effort, called with position and velocity.
    """
    rng = np.random.default_rng(seed + 1000)
    time, q, v, a = wave(robot, seconds, seed)
    effort = robot.inverse_dynamics(q, v, a)
    if callable(extra):
        effort = effort + extra(q, v)
    effort = effort + noise * np.ptp(effort, axis=0) * rng.normal(size=q.shape)
    return prepare(Recording(time, robot.joints, q + 2e-5 * rng.normal(size=q.shape), None, effort))
