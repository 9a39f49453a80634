"""Motions that excite the dynamics: Fourier series within a robot's limits.

Swevers, Ganseman, Tükel, De Schutter, Van Brussel, Optimal robot excitation and identification, IEEE T-RA
13(5), 1997.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bdnn_ros.errors import UsageError
from bdnn_ros.robot import Robot

HIGHEST_FREQUENCY = 1.0
"""Highest harmonic [Hz]."""
STEEPNESS = 0.8
"""Amplitudes decrease with this power of the frequency: wide slow motion plus fast small motion."""
LONGEST_PERIOD = 20.0
"""Base period of the series [s]; a shorter motion has its own duration."""
LOOKED_AT = 3.0 * LONGEST_PERIOD
"""A series is periodic: it is judged by its first part of this length, at 250 points [s]."""
BLEND = 1.5
"""Duration of the transition from rest [s]."""
POSITION_SHARE, VELOCITY_SHARE, EFFORT_SHARE = 0.8, 0.75, 0.75
"""Shares of the limits that the plan uses; the rest is left for tracking errors and effects."""
ACCELERATION_PER_VELOCITY = 3.0
"""Assumed acceleration limit per velocity limit [1/s], as URDFs have none."""
WIDEST = 1.6
"""Largest amplitude of a joint, even if the limits allow more [rad]."""
CANDIDATES = 12
ABOUT_THE_MIDDLE, ANYWHERE = 0.15, 0.4
"""Largest distance of a series' centre from the middle of the range, per range; the second if the first needs too much effort."""
MORE_TRIALS = 10


@dataclass(frozen=True)
class Trajectory:
    """A motion: position, velocity, acceleration, (N, n) each [rad, rad/s, rad/s²], at `time` (N,) [s]."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray

    def of(self, joints: Sequence[int]) -> Trajectory:
        """The motion of some joints, in their order."""
        columns = (one[:, joints] for one in (self.position, self.velocity, self.acceleration))
        return Trajectory(self.time, *columns)


def fourier(robot: Robot, time: np.ndarray, rng: np.random.Generator) -> Trajectory:
    """The most informative of several random Fourier series that keep all limits.

    Args:
        time: evenly spaced from 0, (N,) [s].

    Raises:
        UsageError: no series was found that keeps the limits, or they leave a joint no room.
    """
    best, score = None, -np.inf
    shown = time[time <= LOOKED_AT]
    coarse = shown[:: max(len(shown) // 250, 1)]
    for about in (ABOUT_THE_MIDDLE, *[ANYWHERE] * MORE_TRIALS):
        for _ in range(CANDIDATES):
            series = _scaled(robot, coarse, _Series.drawn(robot, float(time[-1]), rng, about))
            value = -np.inf if series is None else _information(robot, series.at(coarse))
            if value > score:
                best, score = series, value
        if best is not None:
            break
    if best is None:
        raise UsageError(
            "No motion was found that keeps the URDF's effort limits.",
            "Check the effort limits: they should at least hold the arm against gravity.",
        )
    return best.at(time)


def poor(robot: Robot, time: np.ndarray, rng: np.random.Generator, joint: int | None = None) -> Trajectory:
    """One joint moves slowly over a small range, the others rest: a motion that distinguishes few causes.

    Args:
        joint: the joint that moves; None draws one.
    """
    lower, upper = position_range(robot)
    chosen = int(rng.integers(robot.width)) if joint is None else joint
    room, speed = 0.5 * (upper - lower)[chosen], robot.limits.usual_velocity[chosen]
    series = _Series.drawn(robot, float(time[-1]), rng)
    amplitude = np.zeros(robot.width)
    amplitude[chosen] = min(0.15, 0.3 * room, 0.1 * speed / (2.0 * np.pi * 0.1))
    frequencies = np.array([0.1])
    phases = rng.uniform(0.0, 2.0 * np.pi, (robot.width, 1))
    return _Series(series.centre, amplitude[:, None], phases, frequencies).at(time)


@dataclass(frozen=True)
class _Series:
    """q(t) = centre + w(t) · sum_k amplitude_k sin(2π f_k t + phase_k), w a smooth step from rest."""

    centre: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray
    frequencies: np.ndarray

    @classmethod
    def drawn(
        cls, robot: Robot, duration: float, rng: np.random.Generator, about: float = ABOUT_THE_MIDDLE
    ) -> _Series:
        """A random series of unit size about a random pose, at most a share `about` of each range from its middle."""
        period = min(max(duration, 2.0), LONGEST_PERIOD)
        frequencies = np.arange(1, max(int(HIGHEST_FREQUENCY * period), 2) + 1) / period
        shape = (robot.width, len(frequencies))
        amplitude = rng.uniform(0.2, 1.0, shape) / (frequencies / frequencies[0]) ** STEEPNESS
        lower, upper = position_range(robot)
        centre = 0.5 * (lower + upper) + rng.uniform(-about, about, robot.width) * (upper - lower)
        return cls(centre, amplitude, rng.uniform(0.0, 2.0 * np.pi, shape), frequencies)

    def at(self, time: np.ndarray) -> Trajectory:
        """The motion and its derivatives."""
        rate = 2.0 * np.pi * self.frequencies
        angle = rate * time[:, None, None] + self.phase
        sine, cosine = self.amplitude * np.sin(angle), self.amplitude * np.cos(angle)
        wave = sine.sum(2), (rate * cosine).sum(2), -(rate**2 * sine).sum(2)
        w, dw, ddw = (part[:, None] for part in smooth_step(time / BLEND))
        return Trajectory(
            time,
            self.centre + w * wave[0],
            w * wave[1] + dw / BLEND * wave[0],
            w * wave[2] + 2.0 * dw / BLEND * wave[1] + ddw / BLEND**2 * wave[0],
        )

    def resized(self, factor: np.ndarray | float) -> _Series:
        """The same series with each joint's amplitude times a factor."""
        size = np.broadcast_to(np.asarray(factor, float), self.centre.shape)
        return _Series(self.centre, self.amplitude * size[:, None], self.phase, self.frequencies)


def _scaled(robot: Robot, time: np.ndarray, series: _Series) -> _Series | None:
    """The series as large as the limits allow; None if gravity alone exceeds the effort limits."""
    lower, upper = position_range(robot)
    room = POSITION_SHARE * np.minimum(upper - series.centre, series.centre - lower)
    motion = series.at(time)
    velocity = VELOCITY_SHARE * robot.limits.usual_velocity
    acceleration = ACCELERATION_PER_VELOCITY * velocity
    reach = np.abs(motion.position - series.centre).max(axis=0)
    factor = np.minimum(room, WIDEST) / reach
    factor = np.minimum(factor, velocity / np.abs(motion.velocity).max(axis=0))
    factor = np.minimum(factor, acceleration / np.abs(motion.acceleration).max(axis=0))
    series = series.resized(factor)
    for _ in range(12):
        motion = series.at(time)
        effort = robot.inverse_dynamics(motion.position, motion.velocity, motion.acceleration)
        if (np.abs(effort) <= EFFORT_SHARE * robot.limits.effort).all():
            return series
        series = series.resized(0.85)
    return None


def _information(robot: Robot, motion: Trajectory) -> float:
    """Log determinant of the regressor's information about the identifiable parameters."""
    rows = slice(None, None, max(len(motion.time) // 60, 1))
    regressor = robot.regressor(motion.position[rows], motion.velocity[rows], motion.acceleration[rows])
    singular = np.linalg.svd(regressor.reshape(-1, regressor.shape[2]), compute_uv=False)
    return float(np.sum(np.log(np.maximum(singular, 1e-4 * singular[0]))))


def position_range(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """`Limits.usual_range`: position limits, or a turn where there are none or wider ones.

    Raises:
        UsageError: a joint's limits leave it no room, as an exporter writes them that does not know any.
    """
    lower, upper = robot.limits.usual_range
    stuck = [joint for joint, room in zip(robot.joints, upper - lower, strict=True) if room <= 0.0]
    if stuck:
        raise UsageError(f"The URDF's limits leave {', '.join(stuck)} no room to move.", "Widen them.")
    return lower, upper


def smooth_step(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A step from 0 to 1 over [0, 1] with two continuous derivatives, and these derivatives."""
    x = np.clip(x, 0.0, 1.0)
    return (
        x**3 * (10.0 - 15.0 * x + 6.0 * x**2),
        30.0 * x**2 * (1.0 - x) ** 2,
        60.0 * x * (1.0 - x) * (1.0 - 2.0 * x),
    )
