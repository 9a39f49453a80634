"""Robots that rest on their brakes or with motors off: efforts of zero, which say nothing about what acts."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from bdnn_ros.recording import Recording, further, position_noise

WINDOW = 0.5
"""Least duration of rest [s]."""
NOTHING = 2.0
"""An effort is zero if its mean over that time is below this many standard deviations of its noise,"""
UNTRIMMED = 0.01
"""or below this share of the joint's usual effort: no sensor's zero is exact."""
USUAL = 95.0
"""Percentile of the magnitudes that counts as the usual effort [%]."""


def usual_effort(effort: np.ndarray) -> np.ndarray:
    """Magnitude that a joint's efforts (N, n) rarely exceed, (n,)."""
    return np.asarray(np.percentile(np.abs(effort), USUAL, axis=0))


def powerless(recording: Recording) -> np.ndarray:
    """Samples at which all joints rest with zero effort, (N,) bool.

    Joints that bear no load may rest like that as well; losing these samples does no harm, as their motion gives the
    information.
    """
    effort = recording.require_effort()
    size = 2 * int(np.ceil(WINDOW * recording.rate / 2.0)) + 1
    if len(recording) < size:
        return np.zeros(len(recording), bool)
    covered = np.stack(
        [within(recording.position, size, axis=0) for within in (minimum_filter1d, maximum_filter1d)]
    )
    stands = np.asarray(~further(covered, position_noise(recording)).any(axis=1))
    if not stands.any():
        return stands
    # noise by successive differences, so the step when the motors are switched off does not count
    steps = np.diff(effort, axis=0, prepend=effort[:1])
    noise = np.sqrt(uniform_filter1d(steps**2, size, axis=0).clip(0.0) / 2.0)
    untrimmed = UNTRIMMED * usual_effort(effort)
    none = np.abs(uniform_filter1d(effort, size, axis=0)) <= np.maximum(NOTHING * noise, untrimmed)
    whole = (stands & none.all(axis=1)).astype(np.uint8)
    return np.asarray(maximum_filter1d(whole, size) > 0)
