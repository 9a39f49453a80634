"""Joint states that were published several times each, with a stamp of their own: a driver much slower than its publisher."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bdnn_ros.recording import Recording
from bdnn_ros.signals.glitches import RESOLUTIONS, resolution

FEWEST = 10
"""So many messages that are seen to be held show how often each is published."""
REGULAR = 0.9
"""This share of them is held for as many messages as is usual, or for one more or less."""


def without_copies(recording: Recording) -> Recording:
    """The recording with the first message of each that its driver was made to publish several times.

    Copies make stairs of the position, which pass for its noise, and have the effort held for longer than the rate tells.
    Where the robot rests as many messages are left out, so that the rate is that of the driver throughout.
    """
    fields = [recording.position, recording.velocity, recording.effort]
    given = [values for values in fields if values is not None]
    # efforts may be read apart from positions, and tell of copies where positions do not: their encoder is coarse
    for values in (recording.position, np.concatenate(given, axis=1)) if len(recording) > FEWEST else ():
        keep = _first(values)
        if not keep.all():
            copies = f"{np.count_nonzero(~keep)} of {len(keep)} messages are copies of the one before"
            note = f"{recording.name}: {copies}, as of a driver that is slower than its publisher; left out."
            return replace(recording.part(keep), notes=(*recording.notes, note))
    return recording


def _first(values: np.ndarray) -> np.ndarray:
    """Messages, of values (N, n), that are no copies, (N,) bool."""
    fresh = np.append(True, (np.diff(values, axis=0) != 0.0).any(axis=1))
    if fresh.all():
        return fresh
    starts = np.flatnonzero(fresh)
    lasts = np.diff(np.append(starts, len(fresh)))
    times = _times_published(values[starts], lasts)
    after = np.arange(len(fresh)) - np.repeat(starts, lasts)
    # what is held for twice as long is two messages, as of a robot that rests
    return fresh | ((after % times == 0) & (np.repeat(lasts, lasts) - after >= times))


def _times_published(values: np.ndarray, lasts: np.ndarray) -> int:
    """How often each message is published; once where that is not the same throughout.

    Only those count that a reading comes to and leaves by more than it resolves: what a coarse encoder shows for several
    messages it leaves by one step.

    Args:
        values: of messages that differ from the one before, (M, n).
        lasts: how many messages show them, (M,).
    """
    steps = np.abs(np.diff(values, axis=0))
    least = RESOLUTIONS * np.array([resolution(column) for column in values.T])
    clear = np.asarray((steps > least).any(axis=1))
    held = lasts[1:-1][clear[:-1] & clear[1:]]
    if len(held) < FEWEST:
        return 1
    usual = int(np.median(held))
    return usual if np.mean(np.abs(held - usual) <= 1) >= REGULAR else 1
