"""What sensors report of a motion that MuJoCo made."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot


def sensed(
    robot: Robot,
    rows: list[np.ndarray],
    rate: float,
    generator: np.random.Generator,
    stds: tuple[float, float, float] = (2e-5, 2e-3, 0.005),
    of: Callable[..., np.ndarray] = np.std,
) -> Recording:
    """A recording of rows of position, velocity and command, (3 n,) each, with noise.

    Args:
        stds: of the noise of positions, velocities, and the effort as a share of its size.
        of: that size, of each joint's effort.
    """
    position, velocity, effort = np.split(np.array(rows), 3, axis=1)
    noise = generator.standard_normal((3, *position.shape))
    return Recording(
        np.arange(len(rows)) / rate,
        robot.joints,
        position + stds[0] * noise[0],
        velocity + stds[1] * noise[1],
        effort + stds[2] * of(effort, axis=0) * noise[2],
    )
