"""Where a recorded effort says nothing of what acts: a sensor at its limit, a driver that stands still, none at all."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

PLATEAU = 5
"""So many equal samples in a row at a joint's extreme effort are a plateau: the effort was cut off."""
CROWDED = 5.0
"""And so many times as many are there as at the next value: a smooth peak in steps of a sensor has two or three times as many."""
HELD = 3.0
"""Efforts of all joints that stay for so many times as long as they usually do are held by their driver."""

AT_LIMIT = 0.98
"""Efforts this near a limit are at it."""


def unmeasured(effort: np.ndarray) -> np.ndarray:
    """Samples of an effort (N, n) at which it was not measured, (N, n) bool."""
    return cut_off(effort) | held(effort)[:, None] | absent(effort)


def absent(effort: np.ndarray) -> np.ndarray:
    """Joints whose effort is the same throughout, (n,) bool: their driver reports none."""
    return np.asarray(np.ptp(effort, axis=0) == 0.0)


def cut_off(effort: np.ndarray) -> np.ndarray:
    """Samples of runs of at least `PLATEAU` that stay at a joint's highest or lowest effort, (N, n) bool."""
    result = np.zeros(effort.shape, bool)
    for k, column in enumerate(effort.T):
        values, counts = np.unique(column[np.isfinite(column)], return_counts=True)
        for at, beside in ((0, 1), (-1, -2)) if len(values) > 1 else ():
            if counts[at] > CROWDED * counts[beside]:
                for start, stop in _runs(column == values[at]):
                    result[start:stop, k] |= stop - start >= PLATEAU
    return result


def held(effort: np.ndarray) -> np.ndarray:
    """Samples that repeat the efforts of all joints for much longer than is usual here, (N,) bool."""
    fresh = np.flatnonzero(np.append(True, (np.diff(effort, axis=0) != 0.0).any(axis=1)))
    usual = np.percentile(np.diff(fresh), 90.0) if len(fresh) > 1 else len(effort)
    lasts = np.diff(np.append(fresh, len(effort)))
    result = np.repeat(lasts > max(PLATEAU, HELD * usual), lasts)
    result[fresh] = False
    return result


def at_limit(effort: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Samples (N, n) that are cut off, or near a joint's limit (n,), inf for none; one that efforts exceed cuts nothing."""
    limits = np.where(np.abs(effort).max(axis=0) <= limits / AT_LIMIT, limits, np.inf)
    stopped = held(effort)[:, None] & (
        effort.shape[1] > 1
    )  # of one joint alone nothing tells a hold from a limit
    return (cut_off(effort) & ~stopped) | (np.abs(effort) >= AT_LIMIT * limits)


def _runs(inside: np.ndarray) -> Iterator[tuple[int, int]]:
    """Rows [start, stop) of each run of True, of (N,) bool."""
    edges = np.diff(np.concatenate([[0], inside.astype(int), [0]]))
    yield from zip(np.flatnonzero(edges > 0).tolist(), np.flatnonzero(edges < 0).tolist(), strict=True)
