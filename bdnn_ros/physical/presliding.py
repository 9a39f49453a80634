"""Which way dry friction pulls: the direction of motion, with the short travel it takes to turn round."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bdnn_ros.signals import Signals

BREAKAWAYS = (3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2)
"""Travel after which dry friction has turned round [rad]; the shortest is as good as sign(velocity)."""
USUAL = 1
"""Which of them a joint has until its motion shows another: short, yet longer than an encoder's noise."""
SUBSTEPS = 4
"""Steps of a sample period: friction turns round at a time, not at a sample."""
COUPLING_SIGNS = (1, -1)
"""How a motor that turns with two joints may count the first of them."""


@dataclass(frozen=True)
class Directions:
    """State of dry friction along a motion, from -1 to 1, not low-passed.

    Attributes:
        joints: of each joint for each of `BREAKAWAYS`, (N, n, len(BREAKAWAYS)).
        pairs: of motors that turn with joint j + 1 and, by sign, with joint j, (N, n - 1,
            len(COUPLING_SIGNS)).
    """

    joints: np.ndarray
    pairs: np.ndarray

    def at(self, row: int) -> Directions:
        """The state at one sample, where another stretch may go on."""
        return Directions(self.joints[row].copy(), self.pairs[row].copy())


def directions(signals: Signals, start: Directions | None = None) -> Directions:
    """Direction of friction along a motion.

    Args:
        start: state before the first sample; None takes the first direction of each joint.
    """
    q, v, step, segments = signals.position, signals.velocity, 1.0 / signals.rate, signals.segments
    count, pairs = len(signals), (signals.width - 1, len(COUPLING_SIGNS))
    joints = slide(q, v, step, segments, BREAKAWAYS, None if start is None else start.joints)
    motors = slide(
        coupled(q).reshape(count, -1),
        coupled(v).reshape(count, -1),
        step,
        segments,
        BREAKAWAYS[USUAL : USUAL + 1],
        None if start is None else start.pairs.reshape(-1, 1),
    )
    return Directions(joints, motors.reshape(count, *pairs))


def coupled(values: np.ndarray) -> np.ndarray:
    """Values (..., n) of joints as motors see them that turn with two, (..., n - 1, len(COUPLING_SIGNS))."""
    return values[..., 1:, None] + np.array(COUPLING_SIGNS) * values[..., :-1, None]


def slide(
    position: np.ndarray,
    velocity: np.ndarray,
    step: float,
    segments: Sequence[slice],
    breakaways: Sequence[float],
    start: np.ndarray | None,
) -> np.ndarray:
    """Dahl's state of friction along paths (N, m), mean over each sample period, (N, m, len(breakaways)).

    dz = (sign(dq) − z) |dq| / breakaway, exact over each of `SUBSTEPS` (Dahl 1968; Canudas de Wit et al.,
    IEEE TAC 1995). Unlike sign(velocity) it keeps its value at rest.

    Args:
        step: sample period [s].
        start: state at the first sample, (m, len(breakaways)); None takes the first direction of each path.
    """
    result = np.empty((*position.shape, len(breakaways)))
    for segment in segments:
        fine = _between(position[segment], velocity[segment], step)
        travel = np.diff(fine, axis=0)
        sign = np.sign(travel)
        if start is None:
            first = np.argmax(sign != 0.0, axis=0) if len(sign) else 0
            one = sign[first, np.arange(position.shape[1])] if len(sign) else np.zeros(position.shape[1])
            state = np.repeat(one[:, None], len(breakaways), axis=1)
        else:
            state, start = start, None
        keep = np.exp(-np.abs(travel)[:, :, None] / np.asarray(breakaways))
        gain = sign[:, :, None] * (1.0 - keep)
        states = np.empty((len(fine), *state.shape))
        states[0] = state
        for k in range(len(travel)):
            state = gain[k] + keep[k] * state
            states[k + 1] = state
        result[segment] = _mean_around(states)
    return result


def _between(position: np.ndarray, velocity: np.ndarray, step: float) -> np.ndarray:
    """Positions (N, m) with SUBSTEPS − 1 more between each two, on the cubic of both ends' velocities."""
    t = np.arange(SUBSTEPS)[:, None] / SUBSTEPS
    parts = [
        (1.0 + 2.0 * t) * (1.0 - t) ** 2 * position[:-1, None],
        t * (1.0 - t) ** 2 * step * velocity[:-1, None],
        t**2 * (3.0 - 2.0 * t) * position[1:, None],
        t**2 * (t - 1.0) * step * velocity[1:, None],
    ]
    return np.concatenate([sum(parts).reshape(-1, position.shape[1]), position[-1:]])


def _mean_around(states: np.ndarray) -> np.ndarray:
    """Mean of the states of substeps over the period around each sample."""
    half = SUBSTEPS // 2
    before, after = (np.repeat(end, half, axis=0) for end in (states[:1], states[-1:]))
    padded = np.concatenate([before, states, after])
    total = sum(padded[k : len(padded) - SUBSTEPS + k : SUBSTEPS] for k in range(1, SUBSTEPS))
    ends = padded[: len(padded) - SUBSTEPS : SUBSTEPS] + padded[SUBSTEPS::SUBSTEPS]
    return np.asarray((total + 0.5 * ends) / SUBSTEPS)
