"""Choice of the low-pass behind which a diagnosis compares effort and motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.recording import Recording, position_noise, white_noise
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare, usual_cutoff
from bdnn_ros.signals.kernels import gaussian_std, passed_noise

CUTOFFS = (7.0, 6.0, 5.0, 4.2, 3.5, 3.0)
"""Cut-offs tried [Hz], highest first."""
CUTOFF_OF_USUAL = 0.7
"""Highest cut-off of a diagnosis relative to the usual one of signals."""
SLOWER = (2.1, 1.5, 1.0)
"""Lower cut-offs tried for slow motion [Hz], highest first."""
KEPT, MINOR = 0.9, 0.01
"""Motion is slow if the lowest cut-off keeps this share of the velocity's power, at each joint with more than `MINOR` of the
largest power."""
QUIET = 1.0
"""Largest noise from the position, relative to the effort's own."""
ROUNDED = 1e-9
"""Readings that differ by less than this, relative to the largest (at least 1), are equal."""
SLIPS_APART = 4.0
"""Spacing in standard deviations of the low-pass at which slips of a reading by one step do not overlap."""
USUAL_STEP = 0.1
"""Quantile of the sorted differences between neighbouring distinct readings that is taken as the step."""


def quiet_cutoff(recordings: Sequence[Recording], robot: Robot) -> float:
    """Highest cut-off [Hz] at which noise of the position does not dominate that of the effort.

    Noise of the position enters the regressor through the acceleration. Where it dominates, every cause that acts as a
    low-pass (a delay, an elastic joint) seems to explain something.
    """
    highest = CUTOFF_OF_USUAL * min(usual_cutoff(recording.rate) for recording in recordings)
    tried = [cutoff for cutoff in CUTOFFS if cutoff <= highest] or [highest]
    for cutoff in tried:
        if _quiet(recordings, robot, cutoff):
            return cutoff
    return tried[-1]


def slow_cutoff(recordings: Sequence[Recording], robot: Robot, lowest: float) -> float | None:
    """A cut-off [Hz] below the one of `quiet_cutoff`, `lowest`, for slow motion under noise; None if that one suits.

    A controller that follows its encoder's noise makes efforts for accelerations that exist in the noise only: it seems to
    drive a rotor, or through a soft gear. A lower low-pass removes these and costs slow motion nothing.
    """
    slower = [cutoff for cutoff in SLOWER if cutoff < lowest <= CUTOFFS[-1]]
    if not slower or _quiet(recordings, robot, lowest):
        return None
    if not all(_keeps(recording, slower[-1], lowest) for recording in recordings):
        return None
    return next((cutoff for cutoff in slower if _quiet(recordings, robot, cutoff)), slower[-1])


def _keeps(recording: Recording, low: float, high: float) -> bool:
    """Whether the lower cut-off keeps the motion that the higher one does [Hz], noise of the positions aside."""
    parts = prepare(recording, low), prepare(recording, high)
    left, whole = (np.mean(part.velocity**2, axis=0) - part.velocity_noise**2 for part in parts)
    return bool((left > KEPT * whole)[whole > MINOR * whole.max()].all())


def _quiet(recordings: Sequence[Recording], robot: Robot, cutoff: float) -> bool:
    """Whether noise of the positions is no larger than that of the efforts behind a low-pass."""
    return max(_noise_ratio(recording, robot, cutoff) for recording in recordings) <= QUIET


def _noise_ratio(recording: Recording, robot: Robot, cutoff: float) -> float:
    """Largest ratio, over joints, of effort noise caused by the position to the sensor's own."""
    effort = passed_noise(white_noise(recording.require_effort()), gaussian_std(cutoff), recording.rate)
    shaking = passed_noise(position_noise(recording), gaussian_std(cutoff), recording.rate, order=2)
    from_position = _borne(recording, robot, shaking)
    own = np.maximum(effort, 1e-4 * np.std(recording.require_effort(), axis=0))
    return float(np.max(from_position[own > 0.0] / own[own > 0.0], initial=0.0))


def stepping(recordings: Sequence[Recording], robot: Robot, cutoff: float) -> np.ndarray:
    """Upper bound of the apparent effort of bodies that quantised positions cause, (n,) [N·m].

    Quantisation is no noise at rest. Where a joint moves about one step per sample, readings slip by a whole step now and
    then, in a beat that comes and goes. It is worst where slips just do not overlap: the acceleration of one behind a Gaussian
    of standard deviation s has the energy step² / (4 √π s³).
    """
    apart = SLIPS_APART * gaussian_std(cutoff)
    energy = 1.0 / (4.0 * np.sqrt(np.pi) * gaussian_std(cutoff) ** 3)
    each = [_borne(one, robot, _steps(one.position) * np.sqrt(energy / apart)) for one in recordings]
    return np.asarray(np.max(each, axis=0))


def _borne(recording: Recording, robot: Robot, acceleration: np.ndarray) -> np.ndarray:
    """Root mean square effort of each joint under independent accelerations, (n,) [rad/s²] to (n,) [N·m]."""
    some = recording.position[:: max(len(recording) // 50, 1)]
    mass = np.sqrt(np.mean(robot.mass_matrix(some) ** 2, axis=0))
    return np.asarray(np.sqrt(mass**2 @ acceleration**2))


def _steps(values: np.ndarray) -> np.ndarray:
    """Quantisation step of values (N, n), as of an encoder, (n,); next to nothing where there is none."""
    found = np.zeros(values.shape[1])
    for k, column in enumerate(values.T):
        apart = np.diff(np.unique(column))
        apart = apart[apart > ROUNDED * np.abs(column).max(initial=1.0)]
        if len(apart):
            found[k] = np.quantile(apart, USUAL_STEP)
    return found
