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
    turns = np.diff(position, axis=0, prepend=position[:1]) / (2.0 * np.pi)
    whole = np.round(turns)
    jumps = np.where(np.abs(turns - whole) < NEAR, whole, 0.0)
    if not jumps.any():
        return jumps
    low, high = np.percentile(position, (ODD, 100.0 - ODD), axis=0)
    within = high - low < 2.0 * np.pi * (np.abs(jumps).max(axis=0) + NOISE)
    return np.where(within, jumps, 0.0)


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
