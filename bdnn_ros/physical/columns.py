"""What one unit of each coefficient adds to the effort along a motion."""

from __future__ import annotations

import numpy as np

from bdnn_ros.physical.dictionary import Scales, curve, features
from bdnn_ros.physical.presliding import COUPLING_SIGNS, USUAL, Directions, coupled
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mounting import gravity_of, tilt_of
from bdnn_ros.signals import Signals
from bdnn_ros.signals.kernels import convolving_at, gaussian_kernel

TURNED = 1e-4
"""Angle by which the base is turned both ways to see what tilting it adds [rad]."""


def tilting(robot: Robot) -> np.ndarray:
    """What gravity gains per angle by which the robot's base rolls, and pitches, further, (3, 2) [m/s²/rad]."""
    now = np.array(tilt_of(robot.gravity_vector))
    gained = [gravity_of(*(now + step)) - gravity_of(*(now - step)) for step in TURNED * np.eye(2)]
    return np.stack(gained, axis=-1) / (2.0 * TURNED)


def smooth_columns(robot: Robot, signals: Signals, tilts: np.ndarray) -> np.ndarray:
    """Columns that are linear in the motion's derivatives, (N, n, `Columns.coulomb`): low-passed with it.

    Args:
        robot: the bodies as far as they are known.
        tilts: of `tilting`.
    """
    # noise of a joint that stands says nothing; one that turns round accelerates
    moves = ~signals.standing
    q, v, a = signals.position, signals.velocity * moves, signals.acceleration * moves
    own = np.stack([a, v, np.ones_like(q)], axis=-1)
    motors = np.stack([coupled(a), coupled(v)], axis=-1)
    assert signals.effort is not None
    rate = signals.derivative(signals.effort)[:, :, None]  # what a sensor that is a second ahead would add
    by_position, by_gravity = robot.setup_derivatives(q, v, a)
    # a joint that reports too much stands that much further back
    setup = [by_gravity @ tilts, -by_position]
    return np.concatenate([robot.regressor(q, v, a), own, _of_pairs(motors), rate, *setup], axis=-1)


def sharp_columns(signals: Signals, direction: Directions, load: np.ndarray, scales: Scales) -> np.ndarray:
    """The other columns, (N, n, `Columns.count` − `Columns.coulomb`): not low-passed yet.

    Args:
        load: effort that the rigid bodies ask of each joint, (N, n) [N·m].
    """
    learned = features(signals.position, signals.velocity, direction.joints[:, :, USUAL], load, scales)
    limit = scales.velocity[1:, None] + scales.velocity[:-1, None]
    speed = coupled(signals.velocity) / limit
    motors = np.stack([direction.pairs, *curve(speed, direction.pairs)], axis=-1)
    return np.concatenate([direction.joints, learned, _of_pairs(motors)], axis=-1)


def low_passed(signals: Signals, smooth: np.ndarray, sharp: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """All columns at the chosen samples, low-passed as `signals.smooth(signals.effort)` is, (len(rows), n,
    K).

    Sharp columns pass the low-pass twice, as the effort has.
    """
    weights = gaussian_kernel(signals.kernel_std, signals.rate)[0]
    twice = convolving_at(np.convolve(weights, weights), rows, signals.segments)
    soft = (twice @ sharp.reshape(len(signals), -1)).reshape(len(rows), *sharp.shape[1:])
    return np.concatenate([signals.smooth_at(smooth, rows), soft], axis=-1)


def _of_pairs(values: np.ndarray) -> np.ndarray:
    """Columns of coupled motors as each joint sees them, from values (N, n - 1, signs, k), (N, n, 2 · signs
    · k).

    First the motor shared with the joint before, then with the joint after, which counts with its sign.
    """
    count, pairs, signs, terms = values.shape
    before = np.zeros((count, pairs + 1, signs, terms))
    after = np.zeros_like(before)
    before[:, 1:] = values
    after[:, :-1] = values * np.array(COUPLING_SIGNS)[:, None]
    return np.concatenate([before, after], axis=2).reshape(count, pairs + 1, -1)
