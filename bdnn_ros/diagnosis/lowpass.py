"""The low-pass a diagnosis compares effort and motion behind."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.recording import Recording, position_noise, white_noise
from bdnn_ros.robot import Robot
from bdnn_ros.signals import usual_cutoff
from bdnn_ros.signals.kernels import gaussian_std, passed_noise

CUTOFFS = (7.0, 6.0, 5.0, 4.2, 3.5, 3.0)
"""Low-passes tried [Hz], widest first."""
CUTOFF_OF_USUAL = 0.7
"""Motion and effort are compared behind a low-pass at most this share of the usual one."""
QUIET = 1.0
"""Noise from the position may be so large beside the effort's."""


def quiet_cutoff(recordings: Sequence[Recording], robot: Robot) -> float:
    """The highest low-pass [Hz] at which noise of the position does not drown that of the effort.

    Noise of the position reaches the regressor through the acceleration. Where it outweighs the effort's own, everything that
    acts as a further low-pass (a delay, an elastic joint) seems to explain something.
    """
    highest = CUTOFF_OF_USUAL * min(usual_cutoff(recording.rate) for recording in recordings)
    tried = [cutoff for cutoff in CUTOFFS if cutoff <= highest] or [highest]
    for cutoff in tried:
        if max(_noise_ratio(recording, robot, cutoff) for recording in recordings) <= QUIET:
            return cutoff
    return tried[-1]


def _noise_ratio(recording: Recording, robot: Robot, cutoff: float) -> float:
    """Largest ratio, over joints, of the effort's noise that comes from the position to the sensor's own."""
    std = gaussian_std(cutoff)
    some = recording.position[:: max(len(recording) // 50, 1)]
    mass = np.sqrt(np.mean(robot.mass_matrix(some) ** 2, axis=0))
    acceleration = passed_noise(position_noise(recording), std, recording.rate, order=2)
    effort = passed_noise(white_noise(recording.require_effort()), std, recording.rate)
    from_position = np.sqrt(mass**2 @ acceleration**2)
    own = np.maximum(effort, 1e-4 * np.std(recording.require_effort(), axis=0))
    return float(np.max(from_position[own > 0.0] / own[own > 0.0], initial=0.0))
