"""Sensors: the simulated motion as it is reported, with noise and rounding."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.signal import lfilter

from bdnn_ros.errors import UsageError
from bdnn_ros.signals.kernels import trailing

VelocitySource = Literal["sensor", "differentiated", "none"]


@dataclass(frozen=True)
class Noise:
    """Noise and rounding of the sensors.

    Attributes:
        position: standard deviation [rad].
        resolution: step of the encoder [rad], 0 for none.
        velocity: standard deviation where a sensor measures it [rad/s].
        velocity_source: a separate sensor, the backward difference of the position, or none.
        effort: standard deviation as a share of the range of each joint's effort.
        effort_resolution: step of the measured effort as a share of that range, 0 for none.
        correlation: correlation time of the effort noise [s]; 0 is white.
    """

    position: float = 5e-5
    resolution: float = 0.0
    velocity: float = 1e-3
    velocity_source: VelocitySource = "sensor"
    effort: float = 0.005
    effort_resolution: float = 0.0
    correlation: float = 0.0

    @classmethod
    def of(cls, level: float, coloured: bool = False) -> Noise:
        """Noise of the effort at `level` of its range, and all other noise in proportion; 0 for none.

        Raises:
            UsageError: the level is negative or at least 0.5.
        """
        if not 0.0 <= level < 0.5:
            raise UsageError(
                f"A noise of {level:g} of the effort's range makes no sense.", "Use for example 0.005."
            )
        factor = level / cls.effort
        return cls(
            position=cls.position * factor,
            velocity=cls.velocity * factor,
            effort=level,
            correlation=0.05 if coloured else 0.0,
        )


def measured_position(position: np.ndarray, noise: Noise, rng: np.random.Generator) -> np.ndarray:
    """Reported positions, (N, n) [rad]."""
    reported = position + noise.position * rng.standard_normal(position.shape)
    return _rounded(reported, noise.resolution)


def measured_velocity(
    velocity: np.ndarray,
    reported: np.ndarray,
    cutoff: np.ndarray,
    period: float,
    noise: Noise,
    rng: np.random.Generator,
) -> np.ndarray | None:
    """Reported velocities, (N, n) [rad/s], or None.

    Args:
        velocity: true (motor) velocities, (N, n).
        reported: reported positions, for the differentiated velocity.
        cutoff: first-order low-pass that the driver applies, (n,) [Hz], infinite for none.
        period: sample period [s].
    """
    if noise.velocity_source == "none":
        return None
    if noise.velocity_source == "differentiated":
        raw = np.diff(reported, axis=0, prepend=reported[:1]) / period
    else:
        raw = velocity + noise.velocity * rng.standard_normal(velocity.shape)
    result = raw.copy()
    for joint in np.flatnonzero(np.isfinite(cutoff)):
        lag = 1.0 / (2.0 * np.pi * float(cutoff[joint]))
        result[:, joint] = trailing(raw[:, joint], lag, 1.0 / period)
    return result


def measured_effort(effort: np.ndarray, period: float, noise: Noise, rng: np.random.Generator) -> np.ndarray:
    """Reported efforts, (N, n) [N·m]."""
    span = np.ptp(effort, axis=0)
    white = rng.standard_normal(effort.shape)
    if noise.correlation > 0.0:
        keep = float(np.exp(-period / noise.correlation))
        fresh = float(np.sqrt(1.0 - keep**2))
        white[0] /= fresh  # so the first sample has the stationary variance
        white = lfilter([fresh], [1.0, -keep], white, axis=0)
    reported = effort + noise.effort * span * white
    return np.stack(
        [_rounded(reported[:, j], noise.effort_resolution * span[j]) for j in range(len(span))], axis=1
    )


def _rounded(values: np.ndarray, step: float) -> np.ndarray:
    return np.round(values / step) * step if step > 0.0 else values
