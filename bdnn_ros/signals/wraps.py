"""Angles that were recorded modulo one turn: they jump by 2 pi where they leave it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bdnn_ros.errors import listed
from bdnn_ros.recording import Recording

NEAR = 0.2
"""Tolerance of a jump by whole turns [share of a turn]."""
NOISE = 0.05
"""Readings within one turn exceed it by at most this due to noise [share of a turn], ..."""
ODD = 0.5
"""... except so many at either end, which may be outliers [%]."""


def wraps(position: np.ndarray) -> np.ndarray:
    """Whole turns by which each sample jumps from the one before, (N, n); zero if it does not jump by whole turns.

    Only a position that stays within the turn (or turns) of its jumps was recorded so: if its range is larger, the motion is
    fast, or the unit is not radians.

    Args:
        position: [rad], (N, n).
    """
    return _turns(np.diff(position, axis=0, prepend=position[:1]), position)


def between(before: np.ndarray, after: np.ndarray, share: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Positions interpolated at a share (N, 1) of the way from `before` to `after`, (N, n), not across a wrap.

    Args:
        before, after: of `position`, (N, n).
        position: all that is known, (M, n) [rad] ([m]), NaN where nothing is.
    """
    steps = after - before
    turns = _turns(steps, position)
    result = before + share * (steps - 2.0 * np.pi * turns)
    for column in np.flatnonzero(turns.any(axis=0)).tolist():
        middle = sum(_ends(position[:, column])) / 2.0
        here, turned = result[:, column], result[:, column] + 2.0 * np.pi * turns[:, column]
        result[:, column] = np.where(np.abs(turned - middle) < np.abs(here - middle), turned, here)
    return result


def _turns(steps: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Whole turns in steps (N, n) between positions (M, n); zero where it is no wrap, see `wraps`."""
    turns = np.where(np.isfinite(steps), steps, 0.0) / (2.0 * np.pi)
    whole = np.round(turns)
    jumps = np.where(np.abs(turns - whole) < NEAR, whole, 0.0)
    for column in np.flatnonzero(jumps.any(axis=0)).tolist():
        low, high = _ends(position[:, column])
        if high - low >= 2.0 * np.pi * (np.abs(jumps[:, column]).max() + NOISE):
            jumps[:, column] = 0.0
    return jumps


def _ends(position: np.ndarray) -> tuple[float, float]:
    """Range of positions (N,) without the few most extreme, which may be outliers."""
    low, high = np.percentile(position[np.isfinite(position)], (ODD, 100.0 - ODD))
    return float(low), float(high)


def without_wraps(recording: Recording) -> Recording:
    """The recording with wrapped positions made continuous.

    A joint that goes on from pi to -pi has not moved back; uncorrected, its velocity would be hundreds of radians per second.
    """
    turns = wraps(recording.position)
    if not turns.any():
        return recording
    turns[[rows.start for rows in recording.segments()]] = 0.0  # a joint may move anywhere during a gap
    jumps = turns != 0.0
    if not jumps.any():
        return recording
    position = recording.position - 2.0 * np.pi * np.cumsum(turns, axis=0)
    joints = listed(joint for joint, any_ in zip(recording.joints, jumps.any(axis=0), strict=True) if any_)
    note = f"{recording.name}: the position of {joints} was recorded within one turn; {jumps.sum()} jumps are put back."
    return replace(recording, position=position, notes=(*recording.notes, note))
