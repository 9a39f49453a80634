"""Stretches in which a drive rattles: its effort oscillates within a gap, or an unstable loop shakes the robot.

The low-pass removes the oscillation but not its nonlinear effects: what friction, gaps and v² make of it looks like a push.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bdnn_ros.recording import Recording
from bdnn_ros.signals.kernels import convolved, gaussian_kernel, gaussian_std

FASTER = 10.0
"""Oscillations above this frequency [Hz], or a sixth of the rate if that is less, may be rattling."""
STRONG = 0.25
"""Their amplitude is at least this share of the slow effort's standard deviation, ..."""
UNUSUAL = 5.0
"""... this many times the usual fast effort while the joint moves, ..."""
MOST = 0.3
"""... which all but this share of samples stay below, ..."""
STEPS = 3.0
"""... and this many steps of the sensor's resolution."""
OFTEN = 8
"""They change sign at least so many times, on average at `FASTER` or above, ..."""
MOVES, FASTEST = 0.05, 0.99
"""A joint moves where its speed exceeds this share of this quantile of its speeds."""
PAUSE = 0.25
"""... each time within this of the time before [s]."""


def rattling(recording: Recording) -> np.ndarray:
    """Samples at which a joint's drive rattles, (N, n) bool."""
    effort = recording.require_effort()
    segments = recording.segments()
    parts = [_rattling(recording.time[rows], recording.position[rows], effort[rows]) for rows in segments]
    return np.concatenate(parts) if parts else np.zeros(effort.shape, bool)


def _rattling(time: np.ndarray, position: np.ndarray, effort: np.ndarray) -> np.ndarray:
    result = np.zeros(effort.shape, bool)
    if len(time) < OFTEN:
        return result
    rate = 1.0 / float(np.median(np.diff(time)))
    kernel, _, _ = gaussian_kernel(gaussian_std(min(FASTER, rate / 6.0)), rate)
    if len(time) <= len(kernel):
        return result
    slow = convolved(effort, kernel)
    fast = effort - slow
    strong = STRONG * slow.std(axis=0)
    # what rarely exceeds the least bound exceeds the higher ones, which take longer to compute, no more often
    often = [joint for joint in range(len(strong)) if len(_turns(fast[:, joint], strong[joint])) >= OFTEN]
    for joint in often:
        speed = np.abs(np.gradient(convolved(position[:, joint], kernel)))
        moves = speed >= MOVES * np.quantile(speed, FASTEST)
        usual = np.quantile(np.abs(fast[moves, joint]), 1.0 - MOST)
        steps = np.abs(np.diff(effort[:, joint]))
        finest = STEPS * float(steps[steps > 0.0].min(initial=np.inf))
        if np.isfinite(finest):
            for rows in _swings(time, fast[:, joint], max(float(strong[joint]), UNUSUAL * usual, finest)):
                result[rows, joint] = True
    return result


def _turns(fast: np.ndarray, least: float) -> np.ndarray:
    """Rows at which a fast effort (N,) exceeds a size with the sign opposite to the last time, (T,)."""
    beyond = np.flatnonzero(np.abs(fast) > least)
    sign = fast[beyond] > 0.0
    return beyond[1:][sign[1:] != sign[:-1]]


def _swings(time: np.ndarray, fast: np.ndarray, least: float) -> Iterator[slice]:
    """Rows of each stretch in which a fast effort (N,) oscillates beyond some size."""
    turns = _turns(fast, least)
    for run in np.split(turns, np.flatnonzero(np.diff(time[turns]) > PAUSE) + 1):
        if len(run) >= OFTEN and len(run) - 1 > 2.0 * FASTER * (time[run[-1]] - time[run[0]]):
            yield slice(int(run[0]), int(run[-1]) + 1)
