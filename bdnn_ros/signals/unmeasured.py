"""Where a recorded effort says nothing about what acts: a saturated sensor, a stalled driver, or no sensor at all."""

from __future__ import annotations

import numpy as np

from bdnn_ros.recording import Recording, further, position_noise

PLATEAU = 5
"""So many equal samples in a row at a joint's extreme effort are a plateau: the effort is saturated,"""
CROWDED = 5.0
"""if this many times as many samples are there as at the next value (two or three times for a quantised smooth peak),"""
LASTING = 3.0
"""and if it lasts this many times as long as the runs around it: otherwise the effort changes in steps."""
FEW = 10
"""An effort with fewer distinct values, all frequent, changes in steps throughout, as commands may: it has no limit."""
HELD = 3.0
"""The driver holds the efforts if those of all joints are constant for this many times as long as usual."""
OTHERS = 99.0
"""It holds a single joint's if constant for that many times this percentile of the joint's runs [%]"""
HELD_SECONDS = 0.1
"""and for so long at least [s], while the joint moves."""

AT_LIMIT = 0.98
"""An effort above this share of the limit is at the limit."""


def unmeasured(recording: Recording) -> np.ndarray:
    """Samples of a recording with effort at which it was not really measured, (N, n) bool."""
    effort = recording.require_effort()
    return cut_off(effort) | held(effort)[:, None] | held_alone(recording) | absent(effort)


def absent(effort: np.ndarray) -> np.ndarray:
    """Joints whose effort is constant throughout, (n,) bool: their driver reports none."""
    return np.asarray(np.ptp(effort, axis=0) == 0.0)


def cut_off(effort: np.ndarray) -> np.ndarray:
    """Samples of runs of at least `PLATEAU` at a joint's highest or lowest effort that look saturated, (N, n) bool."""
    result = np.zeros(effort.shape, bool)
    repeats = (np.diff(effort, axis=0) == 0.0).sum(axis=0)
    for k in np.flatnonzero(repeats >= PLATEAU - 1):
        column = effort[:, k]
        values, counts = np.unique(column[np.isfinite(column)], return_counts=True)
        if len(values) < 2 or (len(values) < FEW and counts.min() >= PLATEAU):
            continue
        first, lasts = runs(column[:, None])
        beyond = (lasts >= PLATEAU) & (lasts > LASTING * _around(lasts))
        for at, beside in ((0, 1), (-1, -2)):
            if counts[at] > CROWDED * counts[beside]:
                result[:, k] |= np.repeat(beyond & (column[first] == values[at]), lasts)
    return result


def held(effort: np.ndarray) -> np.ndarray:
    """Samples that repeat the efforts of all joints for much longer than usual, (N,) bool."""
    first, lasts = runs(effort)
    if lasts.max() <= PLATEAU:
        return np.zeros(len(effort), bool)
    usual = np.percentile(lasts[:-1], 90.0) if len(first) > 1 else len(effort)
    result = np.repeat(lasts > max(PLATEAU, HELD * usual), lasts)
    result[first] = False
    return result


def held_alone(recording: Recording) -> np.ndarray:
    """Samples that repeat one joint's effort for much longer than ever otherwise, although the joint moves, (N, n) bool."""
    effort = recording.require_effort()
    result = np.zeros(effort.shape, bool)
    least, noise = max(PLATEAU, HELD_SECONDS * recording.rate), position_noise(recording)
    for joint in range(recording.width):
        first, lasts = runs(effort[:, joint : joint + 1])
        if lasts.max() <= least or len(first) < 2:
            continue
        usual = float(np.percentile(lasts, OTHERS, method="lower"))
        long = lasts > max(least, HELD * usual)
        for start, stop in zip(first[long], first[long] + lasts[long], strict=True):
            own = recording.position[start:stop, joint : joint + 1]
            result[start + 1 : stop, joint] = further(own, noise[joint])[0]
    return result & ~cut_off(effort) if result.any() else result


def at_limit(effort: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Samples (N, n) that are saturated or near a joint's limit (n,), inf for none; a limit that efforts exceed is ignored."""
    limits = np.where(np.abs(effort).max(axis=0) <= limits / AT_LIMIT, limits, np.inf)
    stopped = held(effort)[:, None] & (effort.shape[1] > 1)  # with one joint a hold looks like a limit
    return (cut_off(effort) & ~stopped) | (np.abs(effort) >= AT_LIMIT * limits)


def runs(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First row and length of each run of equal rows of (N, k), (K,) each."""
    first = np.flatnonzero(np.append(True, (np.diff(values, axis=0) != 0.0).any(axis=1)))
    return first, np.diff(np.append(first, len(values)))


def _around(lasts: np.ndarray) -> np.ndarray:
    """Median length of the two runs before and the two after each, (K,); mirrored at the ends."""
    padded = np.pad(lasts, 2, mode="reflect")
    return np.asarray(np.median([padded[:-4], padded[1:-3], padded[3:-1], padded[4:]], axis=0))
