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
ROUNDED = 1e-9
"""Readings that differ by less than this share of the largest, or of 1, are one."""
SLIPS_APART = 4.0
"""Slips of a reading by a step do not overlap behind the low-pass when so many of its standard deviations lie between them."""
USUAL_STEP = 0.1
"""Of the differences between one reading and the next larger one, sorted, the one that is the step."""


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
    effort = passed_noise(white_noise(recording.require_effort()), gaussian_std(cutoff), recording.rate)
    shaking = passed_noise(position_noise(recording), gaussian_std(cutoff), recording.rate, order=2)
    from_position = _borne(recording, robot, shaking)
    own = np.maximum(effort, 1e-4 * np.std(recording.require_effort(), axis=0))
    return float(np.max(from_position[own > 0.0] / own[own > 0.0], initial=0.0))


def stepping(recordings: Sequence[Recording], robot: Robot, cutoff: float) -> np.ndarray:
    """Effort that the bodies seem to take where positions are read in steps, at most, (n,) [N·m].

    Steps make no noise at rest. Where a joint goes by about one between two samples they beat with these: then a reading slips
    by a whole step now and then, and what that makes comes and goes. It makes most where slips just do not overlap:
    the acceleration of one behind a Gaussian of standard deviation s has the energy step² / (4 √π s³).
    """
    apart = SLIPS_APART * gaussian_std(cutoff)
    energy = 1.0 / (4.0 * np.sqrt(np.pi) * gaussian_std(cutoff) ** 3)
    each = [_borne(one, robot, _steps(one.position) * np.sqrt(energy / apart)) for one in recordings]
    return np.asarray(np.max(each, axis=0))


def _borne(recording: Recording, robot: Robot, acceleration: np.ndarray) -> np.ndarray:
    """Effort of each joint under accelerations that have nothing to do with each other, (n,) [rad/s²], (n,) [N·m]."""
    some = recording.position[:: max(len(recording) // 50, 1)]
    mass = np.sqrt(np.mean(robot.mass_matrix(some) ** 2, axis=0))
    return np.asarray(np.sqrt(mass**2 @ acceleration**2))


def _steps(values: np.ndarray) -> np.ndarray:
    """Size of the steps in which values (N, n) are read, as of an encoder, (n,); next to nothing where there are none."""
    found = np.zeros(values.shape[1])
    for k, column in enumerate(values.T):
        apart = np.diff(np.unique(column))
        apart = apart[apart > ROUNDED * np.abs(column).max(initial=1.0)]
        if len(apart):
            found[k] = np.quantile(apart, USUAL_STEP)
    return found
