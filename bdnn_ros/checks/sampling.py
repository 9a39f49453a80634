"""Samples that represent a motion."""

from __future__ import annotations

import numpy as np

from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals
from bdnn_ros.signals.kernels import passed_noise

CLEAR = 5.0
"""Least ratio of effort to noise."""
BRISK = 10.0
"""Least ratio of velocity to noise, so that noise hardly biases it towards slow or late."""


def telling(signals: Signals) -> np.ndarray:
    """Where a joint moves and its effort was measured, (N, n) bool."""
    return signals.seen & ~signals.at_rest


def loud(signals: Signals, robot: Robot, rows: np.ndarray) -> np.ndarray:
    """Joints whose effort and rigid-body effort stand out from the sensors' noise in some rows (R,), (n,) bool.

    For a joint that hardly moves, the position's noise outweighs the motion in the rigid-body effort.
    """
    assert signals.effort is not None and signals.effort_noise is not None
    twiced, width, rate = signals.flat is not None, signals.motion_std, signals.raw_rate
    effort_noise = passed_noise(signals.effort_noise, width, rate, twiced=twiced)
    shaking = passed_noise(signals.position_noise, width, rate, order=2, twiced=twiced)
    q, v, a = signals.position[rows], signals.velocity[rows], signals.acceleration[rows]
    bodies = robot.mass_matrix(q) - np.diag(robot.armature)
    borne_noise = np.sqrt(np.mean(np.sum((bodies * shaking) ** 2, axis=2), axis=0))
    borne = robot.rigid_effort(q, v, a)
    clear = np.std(signals.effort[rows], axis=0) > CLEAR * effort_noise
    return np.asarray(clear & (np.std(borne, axis=0) > CLEAR * borne_noise))


def brisk(signals: Signals, rows: np.ndarray) -> np.ndarray:
    """Joints whose velocity in some rows (R,) stands out from its noise, (n,) bool."""
    return np.asarray(np.sqrt(np.mean(signals.velocity[rows] ** 2, axis=0)) > BRISK * signals.velocity_noise)


def some(rows: np.ndarray, most: int) -> np.ndarray:
    """Every so many-th of rows (R,), so that at least `most` are left, but less than twice as many; all if there are fewer."""
    return rows[:: max(len(rows) // most, 1)]


def lowest(values: np.ndarray) -> float:
    """Fractional index of the minimum of values (N,), by a parabola."""
    best = int(np.argmin(values))
    if not 0 < best < len(values) - 1:
        return float(best)
    before, here, after = values[best - 1 : best + 2]
    return best + 0.5 * float((before - after) / (before - 2.0 * here + after))
