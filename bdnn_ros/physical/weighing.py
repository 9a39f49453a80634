"""Weights of the rows of a motion for each joint: low where dry friction is uncertain."""

from __future__ import annotations

import numpy as np

from bdnn_ros.physical.dictionary import Scales
from bdnn_ros.physical.presliding import Directions
from bdnn_ros.signals import Signals

SLIDING = 0.05
TURNING_WEIGHT = 0.2
"""Rows near a joint's reversal, slower than so many velocity limits, count less for its parameters, down to this:
dry friction may then be anything. What is learned beside the parameters is chosen with all speeds alike."""
UNSEEN_WEIGHT = 1e-6
"""What a row counts for a joint whose effort was not measured there."""
REST_WEIGHT = 0.1
"""What a row counts for a joint at rest: dry friction may then hold anything up to its breakaway."""


def certainty(
    signals: Signals, rows: np.ndarray, state: Directions, friction: np.ndarray, residual: np.ndarray
) -> np.ndarray:
    """Share of a row's error variance that does not come from the uncertain direction of friction, (len(rows), n), 0 to 1.

    It is almost zero where no effort was measured. Without these weights slow motion, whose reversals hide in the noise of
    the positions, would override what fast motion tells.

    Args:
        friction: dry friction of each joint, (n,) [N·m].
        residual: standard deviation of what is usually left of each joint, (n,) [N·m].
    """
    doubt = friction * signals.smooth(signals.smooth(state.doubt))[rows]
    measured = np.where(signals.seen[rows], 1.0, UNSEEN_WEIGHT)
    return np.asarray(measured * residual**2 / (residual**2 + doubt**2))


def holding(
    signals: Signals, rows: np.ndarray, state: Directions, unknown: np.ndarray, residual: np.ndarray
) -> np.ndarray:
    """Share of a row's error variance that does not come from static friction of unknown size, (len(rows), n), 0 to 1.

    A resting joint may be held by anything up to its possible friction, however small that is thought to be. The share is
    squared: the static friction is the same throughout a rest, so that many rows say no more than one.

    Args:
        unknown: standard deviation of the dry friction of each joint, (n,) [N·m].
        residual: standard deviation of what is usually left of each joint, (n,) [N·m].
    """
    result = np.ones((len(rows), signals.width))
    some = state.stands.any(axis=0)
    if some.any():
        held = unknown[some] * signals.smooth(signals.smooth(state.stands[:, some]))[rows]
        result[:, some] = (residual[some] ** 2 / (residual[some] ** 2 + held**2)) ** 2
    return result


def sliding(signals: Signals, rows: np.ndarray, scales: Scales) -> np.ndarray:
    """Weights of rows for the parameters by the joints' speed, (len(rows), n)."""
    speed = (signals.velocity[rows] / scales.velocity / SLIDING) ** 2
    return np.asarray(np.maximum(speed / (1.0 + speed), TURNING_WEIGHT))


def moving(signals: Signals, rows: np.ndarray) -> np.ndarray:
    """Weights of rows for the selection of terms, (len(rows), n)."""
    return np.where(signals.at_rest[rows], REST_WEIGHT, 1.0)
