"""Stretches in which a drive rattles: its effort turns round and round within a gap, or a loop is not stable, and all shakes.

The low-pass leaves nothing of it but what is not linear in it: what friction, gaps and v² make of it looks like a push.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bdnn_ros.recording import Recording
from bdnn_ros.signals.kernels import convolved, gaussian_kernel, gaussian_std

FASTER = 10.0
"""What is faster than this [Hz], or a sixth of the rate, may be rattling."""
STRONG = 0.25
"""It swings by this share of the spread of the slow effort at least..."""
UNUSUAL = 5.0
"""... by so many times what most fast efforts do while the joint moves..."""
MOST = 0.3
"""... which are all but this share: what happens more often is usual here..."""
STEPS = 3.0
"""... and by so many steps of a sensor that counts in steps."""
OFTEN = 8
"""It turns round so many times at least, `FASTER` on the whole..."""
MOVES, FASTEST = 0.05, 0.99
"""A joint moves where it is faster than this share of what it is hardly ever faster than, this quantile of its speeds."""
PAUSE = 0.25
"""... and each time no later than this after the time before [s]."""


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
    # what turns round seldom beyond the least bound does not oftener beyond a higher one, which takes longer to find
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
    """Where a fast effort (N,) has gone to the other side beyond some size, (T,)."""
    beyond = np.flatnonzero(np.abs(fast) > least)
    sign = fast[beyond] > 0.0
    return beyond[1:][sign[1:] != sign[:-1]]


def _swings(time: np.ndarray, fast: np.ndarray, least: float) -> Iterator[slice]:
    """Rows from where a fast effort (N,) begins to go to and fro beyond some size to where it ends."""
    turns = _turns(fast, least)
    for run in np.split(turns, np.flatnonzero(np.diff(time[turns]) > PAUSE) + 1):
        if len(run) >= OFTEN and len(run) - 1 > 2.0 * FASTER * (time[run[-1]] - time[run[0]]):
            yield slice(int(run[0]), int(run[-1]) + 1)
