"""The low-pass a diagnosis compares effort and motion behind."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.recording import Recording, position_noise, white_noise
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare, usual_cutoff
from bdnn_ros.signals.kernels import gaussian_std, passed_noise

CUTOFFS = (7.0, 6.0, 5.0, 4.2, 3.5, 3.0)
"""Low-passes tried [Hz], widest first."""
CUTOFF_OF_USUAL = 0.7
"""Motion and effort are compared behind a low-pass at most this share of the usual one."""
SLOWER = (2.1, 1.5, 1.0)
"""Low-passes tried below these where motion is slow [Hz], widest first."""
KEPT, MINOR = 0.9, 0.01
"""Motion is slow where the lowest leaves so much of the velocity's power, of each joint that has more than the second share of
the largest."""
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
        if _quiet(recordings, robot, cutoff):
            return cutoff
    return tried[-1]


def slow_cutoff(recordings: Sequence[Recording], robot: Robot) -> float | None:
    """A low-pass [Hz] below the usual ones that suits slow motion under noise; None where the usual ones do.

    A controller that follows its encoder's noise gives efforts for accelerations that only this noise makes: it seems to
    drive a rotor, or through a soft gear. Slow motion loses nothing behind a low-pass that leaves less of that.
    """
    lowest = quiet_cutoff(recordings, robot)
    slower = [cutoff for cutoff in SLOWER if cutoff < lowest <= CUTOFFS[-1]]
    if not slower or _quiet(recordings, robot, lowest):
        return None
    if not all(_keeps(recording, slower[-1], lowest) for recording in recordings):
        return None
    return next((cutoff for cutoff in slower if _quiet(recordings, robot, cutoff)), slower[-1])


def _keeps(recording: Recording, low: float, high: float) -> bool:
    """Whether one low-pass leaves the motion that a higher one does [Hz]; what noise of the positions makes does not count."""
    parts = prepare(recording, low), prepare(recording, high)
    left, whole = (np.mean(part.velocity**2, axis=0) - part.velocity_noise**2 for part in parts)
    return bool((left > KEPT * whole)[whole > MINOR * whole.max()].all())


def _quiet(recordings: Sequence[Recording], robot: Robot, cutoff: float) -> bool:
    """Whether noise of the positions is no larger than that of the efforts behind a low-pass."""
    return max(_noise_ratio(recording, robot, cutoff) for recording in recordings) <= QUIET


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
