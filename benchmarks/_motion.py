"""Data of the benchmarks: bundled robots, worn, along Fourier motions, as their sensors would report them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals, prepare
from bdnn_ros.simulation.excitation import fourier
from bdnn_ros.simulation.perturbation import worn_robot
from bdnn_ros.simulation.sensors import Noise, measured_position

RATE = 500.0
PIECE = 10.0
"""Every so many seconds a new random motion [s]."""
HELD_OUT = 60.0
"""Seconds of other motions to judge by."""
VALIDATION_SHARE = 0.1


@dataclass(frozen=True)
class Data:
    """Motions of one robot.

    Attributes:
        truth: the robot with rotors and friction that made the efforts.
        nominal: its URDF, without them.
        train, validation, test: signals of one motion each.
        seconds: of motion in train and validation together.
    """

    truth: Robot
    nominal: Robot
    train: list[Signals]
    validation: list[Signals]
    test: list[Signals]
    seconds: float


def data(name: str, seconds: float, seed: int) -> Data:
    """Training motions of a bundled robot, and other motions of the same robot to judge by.

    The effort comes from inverse dynamics along the motion, with noise on position and effort. Robot and
    held-out motions depend on the seed alone, so that methods of other motions are judged alike.
    """
    nominal = Robot.bundled(name)
    rng = np.random.default_rng([seed, nominal.width])
    plain = _motion(nominal, PIECE, rng)
    typical = np.std(nominal.inverse_dynamics(*plain), axis=0)
    truth = worn_robot(nominal, typical, rng)
    test = _signals(truth, [_motion(nominal, PIECE, rng) for _ in range(int(HELD_OUT / PIECE))], rng)
    pieces = max(round(seconds / PIECE), 2)
    learn = _signals(truth, [_motion(nominal, seconds / pieces, rng) for _ in range(pieces)], rng)
    cut = max(round(VALIDATION_SHARE * pieces), 1)
    return Data(truth, nominal, learn[cut:], learn[:cut], test, seconds)


def _motion(
    robot: Robot, seconds: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    plan = fourier(robot, np.arange(int(seconds * RATE)) / RATE, rng)
    return plan.position, plan.velocity, plan.acceleration


def _signals(
    robot: Robot, motions: list[tuple[np.ndarray, np.ndarray, np.ndarray]], rng: np.random.Generator
) -> list[Signals]:
    noise = Noise()
    efforts = [robot.inverse_dynamics(*motion) for motion in motions]
    reach = np.ptp(np.concatenate(efforts), axis=0)
    result = []
    for (position, _, _), effort in zip(motions, efforts, strict=True):
        time = np.arange(len(position)) / RATE
        seen = measured_position(position, noise, rng)
        felt = effort + noise.effort * reach * rng.standard_normal(effort.shape)
        result.append(prepare(Recording(time, robot.joints, seen, None, felt)))
    return result
