"""What one unit of each physical parameter adds to the effort along a motion."""

from __future__ import annotations

import numpy as np

from bdnn_ros.physical.parameters import PER_JOINT
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.signals import Signals


def parameter_columns(robot: Robot, signals: Signals) -> np.ndarray:
    """Columns of each joint's effort, (N, n, n · PER_LINK + PER_JOINT), unsmoothed: bodies, then its own."""
    regressor = robot.regressor(signals.position, signals.velocity, signals.acceleration)
    own = [signals.acceleration, signals.velocity, signals.sign, np.ones_like(signals.position)]
    return np.concatenate([regressor, np.stack(own, axis=-1)], axis=-1)


def parameter_index(width: int) -> np.ndarray:
    """Which of the P parameters each of those columns belongs to, (n, n · PER_LINK + PER_JOINT)."""
    bodies = np.arange(width * PER_LINK)
    own = width * PER_LINK + np.arange(PER_JOINT) * width
    return np.array([np.concatenate([bodies, own + joint]) for joint in range(width)])
