"""What lasts: flags that are up for long enough."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d


def lasting(flags: np.ndarray, least: int) -> np.ndarray:
    """Flags (N, ...) bool that are up for so many samples on end or more; where they are for fewer, none is.

    An opening in time, which running extremes make as fast however long it is.
    """
    if not flags.any():
        return flags
    whole = minimum_filter1d(flags.astype(np.uint8), least, axis=0, mode="constant")
    # a window of an even number of samples has no middle: the way back is by its mirror image
    back = maximum_filter1d(whole, least, axis=0, mode="constant", origin=least % 2 - 1)
    return np.asarray(back > 0)
