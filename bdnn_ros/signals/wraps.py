"""Angles that were recorded within one turn: where they leave it they jump by 2 pi."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bdnn_ros.errors import listed
from bdnn_ros.recording import Recording

NEAR = 0.2
"""A step this near to whole turns is one [share of a turn]."""
NOISE = 0.05
"""Readings within one turn cover so much more of it with their noise [share of a turn]..."""
ODD = 0.5
"""... but for so many of them at either end, which are read wrong [%]."""


def wraps(position: np.ndarray) -> np.ndarray:
    """Whole turns that each sample jumps from the one before, (N, n); zero where it is no jump by whole turns.

    Only what stays within the turn (or turns) it jumps by was recorded so: what goes further is a quick motion, or in another
    unit than radians.

    Args:
        position: [rad], (N, n).
    """
    return _turns(np.diff(position, axis=0, prepend=position[:1]), position)


def between(before: np.ndarray, after: np.ndarray, share: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Positions that lie a share (N, 1) of the way from some to others, (N, n): not across the turn that they are recorded in.

    Args:
        before, after: of `position`, (N, n).
        position: what there is of them, (M, n) [rad] ([m]), NaN where nothing is known.
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
    """Whole turns in steps (N, n) between positions (M, n); zero where it is no jump by whole turns, as in `wraps`."""
    turns = np.where(np.isfinite(steps), steps, 0.0) / (2.0 * np.pi)
    whole = np.round(turns)
    jumps = np.where(np.abs(turns - whole) < NEAR, whole, 0.0)
    for column in np.flatnonzero(jumps.any(axis=0)).tolist():
        low, high = _ends(position[:, column])
        if high - low >= 2.0 * np.pi * (np.abs(jumps[:, column]).max() + NOISE):
            jumps[:, column] = 0.0
    return jumps


def _ends(position: np.ndarray) -> tuple[float, float]:
    """What positions (N,) lie between, but for a few that are read wrong."""
    low, high = np.percentile(position[np.isfinite(position)], (ODD, 100.0 - ODD))
    return float(low), float(high)


def without_wraps(recording: Recording) -> Recording:
    """The recording with the turns put back that a driver took from the position.

    A joint that goes on from pi to -pi has not turned round; left as it is, its velocity is hundreds of radians a second.
    """
    turns = wraps(recording.position)
    if not turns.any():
        return recording
    turns[[rows.start for rows in recording.segments()]] = 0.0  # in a pause a joint may go anywhere
    jumps = turns != 0.0
    if not jumps.any():
        return recording
    position = recording.position - 2.0 * np.pi * np.cumsum(turns, axis=0)
    joints = listed(joint for joint, any_ in zip(recording.joints, jumps.any(axis=0), strict=True) if any_)
    note = f"{recording.name}: the position of {joints} was recorded within one turn; {jumps.sum()} jumps are put back."
    return replace(recording, position=position, notes=(*recording.notes, note))
