"""Stamps that go back: late messages, clock resets, and two publishers."""

from __future__ import annotations

import numpy as np

RESTART = 20
"""So many samples in a row that go back are a clock that starts anew, as in a live stream; fewer came late."""
RESTART_PAUSE = 2.0
"""What follows a new clock comes this long [s] after what was before, or `PAUSE_PERIODS` if that is longer."""
PAUSE_PERIODS = 10.0
DENSER = 0.75
"""Stamps this much closer than those of one publisher come from two."""
FEW_TURNS = 8
"""Messages that change what they hold this seldom come from one publisher, whatever a single stamp of them says."""


def runs(time: np.ndarray) -> tuple[np.ndarray, list[int]]:
    """Which samples to keep if stamps may go back, and where the clock was reset.

    Args:
        time: finite stamps, (N,), none equal to the one before.

    Returns:
        Samples whose stamps increase since the clock started, (N,) bool, and the first row of each clock, 0 included.
    """
    kept = np.ones(len(time), bool)
    starts = [0]
    if (np.diff(time) > 0).all():
        return kept, starts
    stamps = time.tolist()
    latest, row, back = -np.inf, 0, 0
    while row < len(stamps):
        kept[row] = stamps[row] > latest
        back = 0 if kept[row] else back + 1
        if back == RESTART:
            row = row + 1 - RESTART + int(np.argmin(time[row + 1 - RESTART : row + 1]))
            starts.append(row)
            latest, back = -np.inf, 0
            continue
        latest = max(latest, stamps[row])
        row += 1
    return kept, starts


def joined(time: np.ndarray, kept: np.ndarray, starts: list[int]) -> np.ndarray:
    """The kept stamps [s] of `runs`, each clock appended to the one before with a pause between them."""
    moved = time[kept]
    if len(starts) > 1:
        pause = max(RESTART_PAUSE, PAUSE_PERIODS * float(np.median(np.diff(moved))))
        for start in np.searchsorted(np.flatnonzero(kept), starts[1:]):
            moved[start:] += moved[start - 1] + pause - moved[start]
    return moved
