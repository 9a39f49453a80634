"""Where a robot stands on its brakes, or its motors are off: efforts of nothing, which say nothing of what acts."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from bdnn_ros.recording import Recording, further, position_noise

WINDOW = 0.5
"""For at least so long it stands [s]."""
NOTHING = 2.0
"""Efforts are none whose mean over that time is less than so many standard deviations of their noise,"""
UNTRIMMED = 0.01
"""or than this share of what the joint's efforts come to elsewhere: no sensor's zero is right to the last bit."""
USUAL = 95.0
"""What efforts come to: so many percent of them are less."""


def usual_effort(effort: np.ndarray) -> np.ndarray:
    """What the efforts (N, n) of each joint come to, (n,)."""
    return np.asarray(np.percentile(np.abs(effort), USUAL, axis=0))


def powerless(recording: Recording) -> np.ndarray:
    """Samples at which all joints stand and none has an effort, (N,) bool.

    Joints that carry nothing rest like that as well: what is lost of them, their motion tells.
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
    # noise by successive differences: an effort that falls from what held the arm to nothing is no noise
    steps = np.diff(effort, axis=0, prepend=effort[:1])
    noise = np.sqrt(uniform_filter1d(steps**2, size, axis=0).clip(0.0) / 2.0)
    untrimmed = UNTRIMMED * usual_effort(effort)
    none = np.abs(uniform_filter1d(effort, size, axis=0)) <= np.maximum(NOTHING * noise, untrimmed)
    whole = (stands & none.all(axis=1)).astype(np.uint8)
    return np.asarray(maximum_filter1d(whole, size) > 0)
