"""What sensors report of a motion that MuJoCo made."""

from __future__ import annotations

import numpy as np

from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot


def sensed(robot: Robot, rows: list[np.ndarray], rate: float, generator: np.random.Generator) -> Recording:
    """A recording of rows of position, velocity and command, (3 n,) each, with noise."""
    position, velocity, effort = np.split(np.array(rows), 3, axis=1)
    noise = generator.standard_normal((3, *position.shape))
    return Recording(
        np.arange(len(rows)) / rate,
        robot.joints,
        position + 2e-5 * noise[0],
        velocity + 2e-3 * noise[1],
        effort + 0.005 * effort.std(axis=0) * noise[2],
    )
