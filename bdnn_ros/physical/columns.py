"""Regressor columns: the effort per unit of each coefficient along a motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.physical.dictionary import Scales, curve, features
from bdnn_ros.physical.presliding import COUPLING_SIGNS, USUAL, Directions, coupled
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mounting import gravity_of, tilt_of
from bdnn_ros.signals import Signals
from bdnn_ros.signals.kernels import convolved_at, gaussian_kernel

TURNED = 1e-4
"""Angle by which the base is turned both ways to see what tilting it adds [rad]."""


def tilting(robot: Robot) -> np.ndarray:
    """Derivative of the gravity vector by further roll and pitch of the base, (3, 2) [m/s²/rad]."""
    now = np.array(tilt_of(robot.gravity_vector))
    gained = [gravity_of(*(now + step)) - gravity_of(*(now - step)) for step in TURNED * np.eye(2)]
    return np.stack(gained, axis=-1) / (2.0 * TURNED)


def smooth_columns(robot: Robot, signals: Signals, tilts: np.ndarray) -> np.ndarray:
    """Columns that are linear in the motion's derivatives, (N, n, `Columns.coulomb`): the motion's low-pass is theirs.

    Args:
        robot: the bodies as far as they are known.
        tilts: of `tilting`.
    """
    # noise of a joint that stands says nothing; one that turns round accelerates
    moves = ~signals.standing
    q, v, a = signals.position, signals.velocity * moves, signals.acceleration * moves
    assert signals.effort is not None
    rate = signals.derivative(signals.effort)  # what a sensor that is a second ahead would add
    by_position, by_gravity = robot.setup_derivatives(q, v, a)
    # a joint that reports too much stands that much further back
    setup = [by_gravity @ tilts, -by_position]
    motors = _of_pairs([coupled(a), coupled(v)])
    return _side_by_side(robot.regressor(q, v, a), a, v, np.ones_like(q), *motors, rate, *setup)


def sharp_columns(signals: Signals, direction: Directions, load: np.ndarray, scales: Scales) -> np.ndarray:
    """The other columns (friction direction, features), (N, n, `Columns.count` − `Columns.coulomb`), not low-passed yet.

    Args:
        load: effort that the rigid bodies ask of each joint, (N, n) [N·m].
    """
    learned = features(signals.position, signals.velocity, direction.joints[:, :, USUAL], load, scales)
    limit = scales.velocity[1:, None] + scales.velocity[:-1, None]
    speed = coupled(signals.velocity) / limit
    motors = _of_pairs([direction.pairs, *curve(speed, direction.pairs)])
    return _side_by_side(direction.joints, learned, *motors)


def low_passed(signals: Signals, smooth: np.ndarray, sharp: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """All columns at the chosen samples, low-passed as `signals.smooth(signals.effort)` is, (len(rows), n, K).

    Sharp columns pass the low-pass twice, like the effort.
    """
    weights = gaussian_kernel(signals.kernel_std, signals.rate)[0]
    passed = (smooth, weights), (sharp, np.convolve(weights, weights))
    soft = [convolved_at(v.swapaxes(1, 2), kernel, rows, signals.segments) for v, kernel in passed]
    # joint by joint in memory, as sums take them
    return np.ascontiguousarray(np.concatenate(soft, axis=1).transpose(2, 0, 1)).swapaxes(0, 1)


def _side_by_side(*parts: np.ndarray) -> np.ndarray:
    """Columns (N, n, k), or single ones (N, n), concatenated, (N, n, K).

    The joints are contiguous in memory, as in the motions, so that no operation on a long motion strides through memory.
    """
    columns = [part[:, None] if part.ndim == 2 else part.swapaxes(1, 2) for part in parts]
    return np.concatenate(columns, axis=1).swapaxes(1, 2)


def _of_pairs(terms: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Columns of coupled motors for each joint, from terms (N, n - 1, signs): 2 · signs · len(terms) of them, (N, n) each.

    First the motor shared with the joint before, then the one shared with the joint after, which has its sign.
    """
    count, pairs, signs = terms[0].shape
    columns = np.zeros((2, signs, len(terms), count, pairs + 1))
    for sign, factor in enumerate(COUPLING_SIGNS):
        for term, values in enumerate(terms):
            columns[0, sign, term, :, 1:] = values[:, :, sign]
            columns[1, sign, term, :, :-1] = factor * values[:, :, sign]
    return list(columns.reshape(-1, count, pairs + 1))
