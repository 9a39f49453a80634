"""Evenly sampled motion and effort that passed the same low-pass.

Every signal has passed the same Gaussian kernel. What is computed from them (a regressor, a model's effort) passes
`Signals.smooth` once more, and so does the effort it is compared with: filtering both sides alike leaves the parameters
unbiased. A Gaussian does not overshoot, which matters at the steps of dry friction.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.ndimage import convolve1d
from scipy.sparse import csr_array

from bdnn_ros.signals.kernels import (
    convolved,
    convolved_at,
    convolving_at,
    gaussian_kernel,
    gaussian_std,
    lagging,
    passed_noise,
)
from bdnn_ros.signals.lasting import lasting
from bdnn_ros.signals.lowpasses import Lowpass, Response, Restored, kernel_of

UNSEEN = 0.02
"""Share of unmeasured samples in the low-pass from which on the effort is not used."""
SLOW_SHARE = 0.02
"""A joint hardly moves if slower than this share of its usual speed."""
REST_WIDTHS = 5.0
"""A joint slower than this many standard deviations of its velocity's noise counts as at rest."""
STANDING_SECONDS = 0.2
"""A reversal looks like rest for less than this."""
RESTING_SECONDS = 0.5
"""Reversals of all joints at once look like rest for less than this."""


def friction_direction(
    velocity: np.ndarray, acceleration: np.ndarray, rate: float, creep: np.ndarray
) -> np.ndarray:
    """Dry friction of joints relative to its full size, from -1 to 1, averaged over each sample period, (N, n).

    Args:
        velocity, acceleration: [rad/s], [rad/s²], (N, n).
        rate: samples per second [Hz].
        creep: see `Signals`, (n, 3).
    """
    ahead, back, early = creep.T
    coming = velocity + early * acceleration
    turning = np.maximum(np.abs(acceleration) / rate, 2.0 * np.where(coming > 0.0, ahead, back))
    return np.asarray(np.clip(2.0 * coming / np.maximum(turning, 1e-12), -1.0, 1.0))


@dataclass(frozen=True)
class Signals:
    """Evenly sampled, low-passed motion of a recording, at the working rate.

    Attributes:
        time: [s], (N,); segments without a gap are rows of `segments`.
        joints: n joint names.
        position, velocity, acceleration: [rad], [rad/s], [rad/s²], (N, n), from the measured position.
        effort: [N·m], (N, n), or None where it was not measured.
        reported_velocity: the velocity message field, low-passed alike, or None, (N, n).
        rate: working samples per second [Hz].
        cutoff: -3 dB frequency of the low-pass [Hz].
        position_noise: standard deviation of the white noise on the measured position, (n,) [rad].
        raw_rate: the recording's own rate [Hz].
        flat: cut-off of the flattened low-pass that the signals have passed [Hz]; None if that was the one of `smooth`.
        effort_noise: standard deviation of the white noise on the measured effort, (n,) [N·m], or None.
        unmeasured: where the effort says nothing about what acts, (N, n) bool, or None.
        own: low-pass that the efforts had passed before they were recorded, or what remains of it, or None.
        creep: velocities up to which dry friction builds up gradually, forwards and backwards [rad/s], and its lead time
            [s], (n, 3), or None where it steps.
        begun: first stamp of each of several recordings that follow one another [s]; empty for one.
    """

    time: np.ndarray
    joints: tuple[str, ...]
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    effort: np.ndarray | None
    reported_velocity: np.ndarray | None
    rate: float
    cutoff: float
    segments: tuple[slice, ...]
    position_noise: np.ndarray
    raw_rate: float
    flat: float | None = None
    effort_noise: np.ndarray | None = None
    unmeasured: np.ndarray | None = None
    own: Lowpass | Restored | None = None
    creep: np.ndarray | None = None
    begun: tuple[float, ...] = ()

    def __len__(self) -> int:
        return len(self.time)

    @property
    def width(self) -> int:
        """Number of joints n."""
        return len(self.joints)

    @cached_property
    def kernel_std(self) -> float:
        """Standard deviation of the kernel [s]."""
        return gaussian_std(self.cutoff)

    def smooth(self, values: np.ndarray) -> np.ndarray:
        """Low-pass of values (N, ...) along time, segment by segment."""
        return self.behind(values, self.cutoff)

    def smooth_at(self, values: np.ndarray, samples: np.ndarray) -> np.ndarray:
        """`smooth` at some samples in ascending order, (R, ...), without computing the others."""
        return convolved_at(values, gaussian_kernel(self.kernel_std, self.rate)[0], samples, self.segments)

    def smoothing_at(self, samples: np.ndarray) -> csr_array:
        """`smooth_at` as a sparse matrix (R, N), for repeated use."""
        return convolving_at(gaussian_kernel(self.kernel_std, self.rate)[0], samples, self.segments)

    def softening_at(self, samples: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """`soften` and then `smooth` at some samples as one function, (N, k) to (R, k), for repeated use."""
        smoothing = self.smoothing_at(samples)
        if self.own is not None:
            return lambda values: np.asarray(smoothing @ self.soften(values))
        weights = gaussian_kernel(self.motion_std, self.rate)[0]
        once = convolving_at(weights, np.arange(len(self)), self.segments)
        soft = smoothing @ once
        both = soft if self.flat is None else 2.0 * soft - soft @ once
        return lambda values: np.asarray(both @ values)

    def soften(self, values: np.ndarray) -> np.ndarray:
        """Values (N, ...) with steps or ripples faster than the motion, low-passed as the effort was."""
        soft = self.smooth(values) if self.flat is None else self.passed(values, self.flat)
        return soft if self.own is None else self.through(soft, self.own)

    def behind(self, values: np.ndarray, cutoff: float) -> np.ndarray:
        """Values (N, ...) after another Gaussian low-pass of a cut-off [Hz], segment by segment."""
        weights = gaussian_kernel(gaussian_std(cutoff), self.rate)[0]
        return self._along(
            values, lambda part: convolve1d(np.asarray(part, float), weights, axis=0, mode="nearest")
        )

    def through(self, values: np.ndarray, response: Response) -> np.ndarray:
        """Values (N, ...) after another filter without delay, segment by segment."""
        weights = kernel_of(response, self.rate)
        return self._along(values, lambda part: convolved(part, weights))

    def lagging(self, values: np.ndarray, lag: float) -> np.ndarray:
        """Values (N, ...) after a first-order low-pass of a time constant [s], as sensors have, segment by segment."""
        return self._along(values, lambda part: lagging(part, lag, self.rate)) if lag else values

    def derivative(self, values: np.ndarray) -> np.ndarray:
        """Time derivative of values (N, ...), segment by segment."""
        return self._along(values, lambda part: np.gradient(part, 1.0 / self.rate, axis=0))

    def _along(self, values: np.ndarray, each: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """A function applied to each segment of values (N, ...), the results concatenated."""
        return np.concatenate([each(values[rows]) for rows in self.segments])

    def passed(self, values: np.ndarray, cutoff: float) -> np.ndarray:
        """Values (N, ...) after a flattened low-pass (see `flattened`) of another cut-off [Hz]."""
        once = self.behind(values, cutoff)
        return 2.0 * once - self.behind(once, cutoff)

    @cached_property
    def interior(self) -> np.ndarray:
        """Samples at least two standard deviations of `smooth`'s kernel from a segment's end, (N,) bool: no edge effects."""
        return self.interior_after(np.zeros(1))[:, 0]

    def interior_after(self, leads: np.ndarray) -> np.ndarray:
        """Samples that are in the interior of their segment also some times (n,) [s] later, (N, n) bool."""
        margin = int(np.ceil(2.0 * self.kernel_std * self.rate))
        steps = np.ceil(np.abs(leads) * self.rate).astype(int)
        inside = np.zeros((len(self), len(leads)), bool)
        for joint, (step, later) in enumerate(zip(steps.tolist(), leads > 0.0, strict=True)):
            before, after = (margin, margin + step) if later else (margin + step, margin)
            for rows in self.segments:
                inside[rows.start + before : max(rows.stop - after, rows.start), joint] = True
        return inside

    @cached_property
    def direction(self) -> np.ndarray:
        """Direction of dry friction averaged over each sample period, (N, n): a reversal in between counts in part."""
        creep = np.zeros((self.width, 3)) if self.creep is None else self.creep
        return friction_direction(self.velocity, self.acceleration, self.rate, creep)

    @cached_property
    def sign(self) -> np.ndarray:
        """`direction`, low-passed as the effort was, (N, n): steps of dry friction are equally soft in both."""
        return self.soften(self.direction)

    @property
    def motion_std(self) -> float:
        """Standard deviation of the Gaussian that position and velocity have passed [s]; that of `smooth` may differ."""
        return self.kernel_std if self.flat is None else gaussian_std(self.flat)

    @cached_property
    def velocity_noise(self) -> np.ndarray:
        """Standard deviation of the velocity's noise that comes from the position's, (n,) [rad/s]."""
        twiced = self.flat is not None
        return passed_noise(self.position_noise, self.motion_std, self.raw_rate, order=1, twiced=twiced)

    @cached_property
    def rest_velocity(self) -> np.ndarray:
        """Speed below which a joint counts as at rest, (n,) [rad/s]."""
        return np.maximum(REST_WIDTHS * self.velocity_noise, 1e-5)

    @cached_property
    def at_rest(self) -> np.ndarray:
        """Where a joint is at rest, so that dry friction has no direction, (N, n) bool."""
        slow = np.abs(self.velocity) < self.rest_velocity
        return slow & (np.abs(self.acceleration) * self.motion_std < 2.0 * self.rest_velocity)

    @cached_property
    def standing(self) -> np.ndarray:
        """Where a joint is at rest for longer than a reversal takes, (N, n) bool."""
        return self.lasting(self.at_rest, STANDING_SECONDS)

    @cached_property
    def hardly_moves(self) -> np.ndarray:
        """Where a joint is so much slower than usual that it may stick, (N, n) bool."""
        moving = ~self.at_rest
        squared = np.sum(np.where(moving, self.velocity, 0.0) ** 2, axis=0)
        usual = np.sqrt(squared / np.maximum(moving.sum(axis=0), 1))
        return np.asarray(np.abs(self.velocity) < SLOW_SHARE * usual)

    @cached_property
    def resting(self) -> np.ndarray:
        """Where all joints (nearly) rest for longer than a reversal takes, (N,) bool."""
        return self.lasting((self.at_rest | self.hardly_moves).all(axis=1), RESTING_SECONDS)

    def lasting(self, flags: np.ndarray, least: float) -> np.ndarray:
        """Flags (N, ...) bool that are set for at least so long [s]; see `lasting`."""
        return lasting(flags, max(int(np.ceil(least * self.rate)), 1))

    @cached_property
    def seen(self) -> np.ndarray:
        """Where the effort, low-passed once more, hardly contains unmeasured samples, (N, n) bool."""
        if self.unmeasured is None or not self.unmeasured.any():
            return np.ones(self.position.shape, bool)
        return np.abs(self.smooth(self.soften(self.unmeasured.astype(float)))) < UNSEEN

    def between(self, start: float, end: float) -> Signals:
        """The samples with start <= time < end [s]."""
        return self.rows((self.time >= start) & (self.time < end))

    def rows(self, chosen: np.ndarray) -> Signals:
        """The chosen samples, (N,) bool; segments are split where samples are left out."""
        index = np.flatnonzero(chosen)
        owner = np.repeat(np.arange(len(self.segments)), [s.stop - s.start for s in self.segments])
        breaks = np.flatnonzero((np.diff(index) > 1) | (np.diff(owner[index]) != 0)) + 1
        edges = [0, *breaks.tolist(), len(index)]
        return replace(
            self,
            time=self.time[index],
            position=self.position[index],
            velocity=self.velocity[index],
            acceleration=self.acceleration[index],
            effort=None if self.effort is None else self.effort[index],
            reported_velocity=None if self.reported_velocity is None else self.reported_velocity[index],
            unmeasured=None if self.unmeasured is None else self.unmeasured[index],
            segments=tuple(slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True) if b > a),
        )
