"""Flags that are set for long enough."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d


def lasting(flags: np.ndarray, least: int) -> np.ndarray:
    """Flags (N, ...) bool that are set for at least so many consecutive samples; shorter runs are cleared.

    A morphological opening in time by running extremes, as fast for any length.
    """
    if not flags.any():
        return flags
    whole = minimum_filter1d(flags.astype(np.uint8), least, axis=0, mode="constant")
    # an even window has no middle sample: dilate with the mirrored window
    back = maximum_filter1d(whole, least, axis=0, mode="constant", origin=least % 2 - 1)
    return np.asarray(back > 0)
