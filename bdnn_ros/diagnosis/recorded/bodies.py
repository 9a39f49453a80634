"""Columns of all that bodies may add to a joint's effort, so that none of it is taken for friction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals

LIGHTEST = 1e-300


def of_bodies(signals: Signals, robot: Robot) -> np.ndarray:
    """Columns of errors of links, gravity's direction and zeros, and of mass-proportional damping, (N, n, 11 n + 5)."""
    q, v, a = signals.position, signals.velocity, signals.acceleration
    pulls = [replace(robot, gravity_vector=axis).gravity(q) for axis in np.eye(3)]
    zeros = robot.effort_derivatives(q, v, a)[0]
    further = np.stack([*pulls, *_in_a_medium(robot, q, v)], axis=-1)
    return np.concatenate([robot.regressor(q, v, a), further, zeros], axis=-1)


def _in_a_medium(robot: Robot, position: np.ndarray, velocity: np.ndarray) -> list[np.ndarray]:
    """Efforts (N, n) of a medium that damps every body by its mass times velocity, M(q) v, and times velocity squared.

    Simulators do so whose bodies lose a share of their momentum each second.
    """
    floating = replace(robot, gravity_vector=np.zeros(3))
    columns = floating.regressor(position, np.zeros_like(position), velocity)
    each = (columns.reshape(*position.shape, *robot.inertials.shape) * robot.inertials).sum(axis=-1)
    twice_energy = np.einsum("tj,tjk->tk", velocity, each).clip(0.0)
    speed = np.sqrt(twice_energy / np.maximum(robot.inertials[:, 0], LIGHTEST))
    return [each.sum(axis=-1), (each * speed[:, None]).sum(axis=-1)]
