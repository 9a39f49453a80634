"""Joint states published several times each, every copy with its own stamp: a driver much slower than its publisher."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bdnn_ros.recording import Recording
from bdnn_ros.signals.glitches import RESOLUTIONS, resolution

FEWEST = 10
"""Least number of clearly repeated messages to tell how often each is published."""
REGULAR = 0.9
"""Least share of them that is published as often as the median, plus or minus one."""


def without_copies(recording: Recording) -> Recording:
    """The recording with only the first of the messages that its driver published several times.

    Copies turn the position into stairs, which look like noise, and hold the effort for longer than the rate suggests. Where
    the robot rests as many messages are dropped, so that the rate is the driver's throughout.
    """
    fields = [recording.position, recording.velocity, recording.effort]
    given = [values for values in fields if values is not None]
    # with a coarse encoder positions may not reveal copies, but efforts, which may be read separately, do
    for values in (recording.position, np.concatenate(given, axis=1)) if len(recording) > FEWEST else ():
        keep = _first(values)
        if not keep.all():
            copies = f"{np.count_nonzero(~keep)} of {len(keep)} messages are copies of the one before"
            note = f"{recording.name}: {copies}, as of a driver that is slower than its publisher; left out."
            return replace(recording.part(keep), notes=(*recording.notes, note))
    return recording


def _first(values: np.ndarray) -> np.ndarray:
    """Messages, of values (N, n), that are not copies, (N,) bool."""
    fresh = np.append(True, (np.diff(values, axis=0) != 0.0).any(axis=1))
    if fresh.all():
        return fresh
    starts = np.flatnonzero(fresh)
    lasts = np.diff(np.append(starts, len(fresh)))
    times = _times_published(values[starts], lasts)
    after = np.arange(len(fresh)) - np.repeat(starts, lasts)
    # values held twice as long are two messages, as of a robot at rest
    return fresh | ((after % times == 0) & (np.repeat(lasts, lasts) - after >= times))


def _times_published(values: np.ndarray, lasts: np.ndarray) -> int:
    """How often each message is published; 1 if that is not the same throughout.

    Only messages count whose value differs by more than the resolution from the ones before and after: a coarse encoder may
    show a value for several messages, but then changes by one step.

    Args:
        values: of messages that differ from the one before, (M, n).
        lasts: number of consecutive messages that show each value, (M,).
    """
    steps = np.abs(np.diff(values, axis=0))
    least = RESOLUTIONS * np.array([resolution(column) for column in values.T])
    clear = np.asarray((steps > least).any(axis=1))
    held = lasts[1:-1][clear[:-1] & clear[1:]]
    if len(held) < FEWEST:
        return 1
    usual = int(np.median(held))
    return usual if np.mean(np.abs(held - usual) <= 1) >= REGULAR else 1
