"""What each row of a motion says of each joint: less where dry friction may be anything."""

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
    """Share of a row's error that is not doubt of friction's direction, (len(rows), n), 0 to 1; hardly any if unmeasured.

    Without it slow motion, whose reversals the position's noise hides, pulls over what fast motion told.

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
    """Share of a row's error that is not static friction of unknown size, (len(rows), n), 0 to 1.

    A joint that stands may be held by as much as its friction may be, however small it is taken to be. It counts
    squared: what holds is the same all the while, so that many rows say no more than one.

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
    """What rows count for the parameters by the joints' speed, (len(rows), n)."""
    speed = (signals.velocity[rows] / scales.velocity / SLIDING) ** 2
    return np.asarray(np.maximum(speed / (1.0 + speed), TURNING_WEIGHT))


def moving(signals: Signals, rows: np.ndarray) -> np.ndarray:
    """What rows count for the choice of what is learned, (len(rows), n)."""
    return np.where(signals.at_rest[rows], REST_WEIGHT, 1.0)
