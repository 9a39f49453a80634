"""What of dry friction that comes on little by little is there if all of it is a little later than it seems."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals

DOUBT = 0.01
"""To this share it is known at what velocity all of it is there."""


def later(signals: Signals, reduced: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Efforts of k joints per N·m of friction and per relative change of that velocity, (R, n, k).

    Args:
        reduced: what is made of efforts (N, n), (R, n).
    """
    change = np.zeros_like(signals.velocity)
    if signals.creep is not None:
        other = replace(signals, creep=signals.creep * [1.0 + DOUBT, 1.0 + DOUBT, 1.0])
        change = signals.soften(other.direction - signals.direction) / DOUBT
    return np.asarray(reduced(change)[..., None] * _each(signals))


def later_spread(signals: Signals, robot: Robot, effort: np.ndarray) -> np.ndarray:
    """Prior standard deviation of what these are multiplied with, (k,) [N·m], given the spread of each joint's effort, (n,).

    Friction that a robot is described with may be many times what its motion takes.
    """
    return np.asarray(DOUBT * np.maximum(robot.coulomb, effort) @ _each(signals))


def _each(signals: Signals) -> np.ndarray:
    """Which joint each of k is whose friction comes on little by little, (n, k) of 0 and 1."""
    every = np.eye(signals.width)
    return every[:, :0] if signals.creep is None else every[:, signals.creep[:, :2].any(axis=1)]
