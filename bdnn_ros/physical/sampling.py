"""Some samples of a motion that stand for all of it."""

from __future__ import annotations

import numpy as np

from bdnn_ros.signals import Signals


def telling(signals: Signals) -> np.ndarray:
    """Where a joint moves and its effort was measured, (N, n) bool."""
    return signals.seen & ~signals.at_rest


def some(rows: np.ndarray, most: int) -> np.ndarray:
    """Rows (R,) as far apart as leaves at least so many of them, less than twice as many; all where there are fewer."""
    return rows[:: max(len(rows) // most, 1)]
