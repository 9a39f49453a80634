"""Direction of dry friction along a motion, with the short travel (pre-sliding) that it needs to reverse."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from bdnn_ros.recording import further
from bdnn_ros.signals import Signals
from bdnn_ros.signals.lasting import lasting

BREAKAWAYS = (0.0, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2)
"""Travel in which dry friction turns round [rad]; zero turns with the velocity."""
USUAL = 0
"""Which of them a joint has until its motion shows another."""
SLOW = 5e-3
RESTING_SECONDS = 0.2
RESTING = 1
"""Slower than this [rad/s] for so long, a joint rests, and its friction is that of this breakaway."""
TURNED = 1e-4
NOISE_WIDTHS = 4.0
"""A joint has turned round once it went back so far [rad], and so many standard deviations of its noise."""
CERTAIN = 4.0
"""Faster than so many standard deviations of its noise, a velocity's sign is known."""
REVERSAL = 0.62
"""What is left of the direction's doubt across a reversal, whose errors on either side partly cancel: the noise moves
it by as much as it takes to travel, 2 σ / a, where the doubts of all its instants add up to 3.2 σ / a."""
SMALLEST = 1e-300
"""Smallest noise, of what rests."""
SUBSTEPS = 4
"""Steps of a sample period: friction turns round at a time, not at a sample."""
COUPLING_SIGNS = (1, -1)
"""How a motor that turns with two joints may count the first of them."""


@dataclass(frozen=True)
class Directions:
    """State of dry friction along a motion, from -1 to 1, not low-passed.

    Attributes:
        joints: of each joint for each of `BREAKAWAYS`, (N, n, len(BREAKAWAYS)).
        pairs: of motors that turn with joint j + 1 and, by sign, with j, (N, n - 1, len(COUPLING_SIGNS)).
        doubt: standard deviation of the first of each joint's, (N, n), from 0 to 1.
        stands: where a joint rests or gives way by no more than a count, so that friction may hold anything, (N, n) bool.
    """

    joints: np.ndarray
    pairs: np.ndarray
    doubt: np.ndarray
    stands: np.ndarray

    def at(self, row: int) -> Directions:
        """The state at one sample, where another stretch may go on."""
        parts = self.joints, self.pairs, self.doubt, self.stands
        return Directions(*(part[row].copy() for part in parts))


def directions(signals: Signals, start: Directions | None = None) -> Directions:
    """Direction of dry friction along a motion.

    Where the velocity is close to its noise σ, it is the expected direction erf(v / (√2 σ)).

    Args:
        start: state before the first sample; None takes the first direction of each joint.
    """
    width, count = signals.width, len(signals)
    noise = signals.position_noise / np.sqrt(max(signals.kernel_std * signals.raw_rate, 1.0))
    turned = np.maximum(TURNED, NOISE_WIDTHS * noise)
    both = np.repeat(turned[1:] + turned[:-1], len(COUPLING_SIGNS)) / 2.0
    joints = np.empty((count, len(BREAKAWAYS), width)).swapaxes(1, 2)  # in memory as `slide` leaves it
    doubt, stands = np.empty((count, width)), np.empty((count, width), bool)
    pairs = np.empty((count, (width - 1) * len(COUPLING_SIGNS)))
    for rows in signals.segments:
        fine = _between(signals.position[rows], signals.velocity[rows], 1.0 / signals.rate)
        motors = coupled(fine).reshape(len(fine), -1)
        before = None if start is None else start.joints[:, 0]
        velocity = signals.velocity[rows]
        kept = _mean_around(turning(fine, turned, before))
        slow = np.abs(velocity) < CERTAIN * signals.velocity_noise
        joints[rows, :, 0] = np.where(slow, _expected(velocity, signals.velocity_noise), kept)
        doubt[rows] = _doubt(signals, rows)
        pairs[rows] = _mean_around(turning(motors, both, None if start is None else start.pairs.ravel()))
        state = joints[rows.start, :, :1] if start is None else start.joints[:, 1:]
        joints[rows, :, 1:] = _mean_around(slide(fine, BREAKAWAYS[1:], state))
        rest = _at_rest(coupled(velocity).reshape(len(velocity), -1), signals.rate)
        if (few := rest.any(axis=0)).any():
            resting = slide(motors[:, few], BREAKAWAYS[RESTING : RESTING + 1], pairs[rows.start, few, None])
            pairs[rows, few] = np.where(rest[:, few], 0.5 * _mean_around(resting)[:, :, 0], pairs[rows, few])
        rest = _at_rest(velocity, signals.rate)
        joints[rows, :, 0] = np.where(rest, 0.5 * joints[rows, :, RESTING], joints[rows, :, 0])
        # a joint that has not moved yet may hold any friction
        still = ~further(signals.position[rows], noise)
        still = still if start is None else still & (start.joints == 0.0).all(axis=1)
        joints[rows, still] = 0.0
        stands[rows] = standing(signals.position[rows], noise, rest) | still
        doubt[rows] = np.where(stands[rows], 1.0, doubt[rows])
        start = None
    return Directions(joints, pairs.reshape(count, width - 1, len(COUPLING_SIGNS)), doubt, stands)


def _expected(velocity: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Expected direction of measured velocities (N, n) with this noise, (n,) or (N, n)."""
    return np.asarray(erf(velocity / (np.sqrt(2.0) * np.maximum(std, SMALLEST))))


def _doubt(signals: Signals, rows: slice) -> np.ndarray:
    """Standard deviation of that direction, (N, n).

    Noise hides the sign of a slow velocity. No sample tells whether friction reversed between two samples; a timing error τ
    is a velocity error a τ. Where a joint sticks, its friction may be anything, and the low-pass hides that: it turns a stop
    into a velocity of its variance times the jerk.
    """
    velocity, acceleration = _finer(signals.velocity[rows]), _finer(signals.acceleration[rows])
    apart = np.hypot(1.0 / signals.raw_rate, 1.0 / (SUBSTEPS * signals.rate))
    std = np.hypot(signals.velocity_noise, acceleration * apart / np.sqrt(12.0))
    turns = REVERSAL * np.sqrt(1.0 - _expected(velocity, std) ** 2)
    jerk = np.diff(acceleration, axis=0, append=acceleration[-1:]) * SUBSTEPS * signals.rate
    hidden = signals.motion_std**2 * np.abs(jerk) - CERTAIN * signals.velocity_noise
    stops = np.sqrt(1.0 - _expected(velocity, np.maximum(hidden, 0.0)) ** 2)
    return _mean_around(np.maximum(turns, stops))


def coupled(values: np.ndarray) -> np.ndarray:
    """Joint values (..., n) as seen by coupled motors, (..., n - 1, len(COUPLING_SIGNS))."""
    return values[..., 1:, None] + np.array(COUPLING_SIGNS) * values[..., :-1, None]


def turning(position: np.ndarray, turned: np.ndarray, start: np.ndarray | None) -> np.ndarray:
    """Direction of paths (M, m), -1 or 1; it changes where a path reverses by more than its noise.

    Unlike sign(velocity) it keeps its value at rest.

    Args:
        turned: how far a path must go back, (m,).
        start: direction at first, (m,); None takes the first one.
    """
    result = np.empty_like(position)
    for k, (path, least) in enumerate(zip(position.T, turned, strict=True)):
        steps = np.sign(np.diff(path))
        ends = np.flatnonzero(steps[1:] * steps[:-1] <= 0.0) + 1
        way = 0.0 if start is None else float(np.sign(start[k]))
        last, furthest = 0, 0
        for index in (*ends.tolist(), len(path) - 1):
            back = path[index] - path[furthest]
            if back * way >= 0.0 and way != 0.0:
                furthest = index
            elif abs(back) > least:
                if way != 0.0:
                    result[last:furthest, k] = way
                    last = furthest
                way, furthest = float(np.sign(back)), index
        result[last:, k] = way
    return result


def slide(position: np.ndarray, breakaways: Sequence[float], start: np.ndarray) -> np.ndarray:
    """Dahl's state of friction along paths (M, m), (M, m, len(breakaways)).

    dz = (sign(dq) − z) |dq| / breakaway, exact over each step (Dahl 1968; Canudas de Wit et al., IEEE TAC 1995).

    Args:
        start: state at first, (m, 1 or len(breakaways)).
    """
    # stretches of steps side by side, each from nothing; then each goes on from where the one before it ended
    steps, width = len(position) - 1, position.shape[1]
    stretches = max(round(np.sqrt(steps)), 1)
    length = -(-steps // stretches)
    still = np.zeros((stretches * length - steps, width))
    travel = np.concatenate([np.diff(position, axis=0), still]).reshape(stretches, length, width)
    travel = np.ascontiguousarray(travel.swapaxes(0, 1))[:, None]
    keep = np.exp(-np.abs(travel) / np.reshape(breakaways, (-1, 1, 1)))
    gain = np.sign(travel) * (1.0 - keep)
    for k in range(1, length):
        gain[k] += keep[k] * gain[k - 1]
        keep[k] *= keep[k - 1]
    states = np.empty((1 + stretches * length, len(breakaways), width))
    states[0] = start.T
    for stretch in range(stretches):
        end = stretch * length
        states[end + 1 : end + 1 + length] = gain[:, :, stretch] + keep[:, :, stretch] * states[end]
    return states[: len(position)].swapaxes(1, 2)


def _at_rest(velocity: np.ndarray, rate: float) -> np.ndarray:
    """Where paths with these velocities (N, m) are at rest, (N, m) bool."""
    least = int(np.ceil(RESTING_SECONDS * rate))
    return lasting(np.abs(velocity) < SLOW, least)


def standing(position: np.ndarray, noise: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Where joints at positions (N, n) rest, or move within noise and encoder resolution between rests, (N, n) bool.

    A flip of one encoder count looks like motion, but static friction holds across it.

    Args:
        noise: standard deviation of the positions, (n,) [rad].
        rest: where they are slow for long, (N, n) bool.
    """
    result = rest.copy()
    for k in np.flatnonzero(rest.any(axis=0) & ~rest.all(axis=0)):
        edges = np.flatnonzero(np.diff(~rest[:, k], prepend=False, append=False))
        for begin, end in edges.reshape(-1, 2).tolist():
            way = position[max(begin - 1, 0) : end + 1, k, None]
            result[begin:end, k] = not further(way, noise[k : k + 1])[0]
    return result


def _between(position: np.ndarray, velocity: np.ndarray, step: float) -> np.ndarray:
    """Positions (N, m) with SUBSTEPS − 1 more between each two, by cubic interpolation with the velocities."""
    t = np.arange(SUBSTEPS)[:, None] / SUBSTEPS
    parts = (
        (1.0 + 2.0 * t) * (1.0 - t) ** 2 * position[:-1, None]
        + t * (1.0 - t) ** 2 * step * velocity[:-1, None]
        + t**2 * (3.0 - 2.0 * t) * position[1:, None]
        + t**2 * (t - 1.0) * step * velocity[1:, None]
    )
    return np.concatenate([parts.reshape(-1, position.shape[1]), position[-1:]])


def _finer(values: np.ndarray) -> np.ndarray:
    """Values (M, n) with SUBSTEPS − 1 more between each two, by linear interpolation."""
    t = np.arange(SUBSTEPS)[:, None] / SUBSTEPS
    parts = (1.0 - t) * values[:-1, None] + t * values[1:, None]
    return np.concatenate([parts.reshape(-1, values.shape[1]), values[-1:]])


def _mean_around(states: np.ndarray) -> np.ndarray:
    """Mean of the substeps' states over the period around each sample."""
    half = SUBSTEPS // 2
    before, after = (np.repeat(end, half, axis=0) for end in (states[:1], states[-1:]))
    padded = np.concatenate([before, states, after])
    total = sum(padded[k : len(padded) - SUBSTEPS + k : SUBSTEPS] for k in range(1, SUBSTEPS))
    ends = padded[: len(padded) - SUBSTEPS : SUBSTEPS] + padded[SUBSTEPS::SUBSTEPS]
    return np.asarray((total + 0.5 * ends) / SUBSTEPS)
