"""Sensor noise in a joint's residual, and its correlation between neighbouring rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals
from bdnn_ros.signals.kernels import passed_noise

POSES = 6
"""Positions of a chunk at which the bodies' columns are asked what noise on the acceleration does to them."""
CHANCE = 2.0
"""Standard deviations of the residual's variance that chance may add to what the sensors explain."""


@dataclass(frozen=True)
class SensorNoise:
    """White sensor noise after the low-pass, summed over rows.

    Attributes:
        effort: Σ variance by noise on the effort, (n,) [N²·m²].
        alike: Σ of the same times the rows that it takes for an independent one, (n,) [N²·m²]: a Gaussian low-pass
            leaves noise whose neighbours are alike.
        columns: Σ covariance of the columns of bodies and armature by noise on the position, (n, k, k). Twice
            differentiated, it is nearly independent from row to row.
        count: rows.
    """

    effort: np.ndarray
    alike: np.ndarray
    columns: np.ndarray
    count: float

    @classmethod
    def of(cls, robot: Robot, signals: Signals, rows: np.ndarray) -> SensorNoise:
        """The noise in the chosen rows of a motion that was low-passed twice, as `columns.low_passed` does."""
        assert signals.effort_noise is not None
        width, rate = np.sqrt(2.0) * signals.kernel_std, signals.raw_rate
        spacing = (rows[-1] - rows[0]) / (signals.rate * (len(rows) - 1)) if len(rows) > 1 else width
        repeated = max(2.0 * np.sqrt(np.pi) * width / spacing, 1.0)
        effort = passed_noise(signals.effort_noise, width, rate) ** 2 * len(rows)
        acceleration = passed_noise(signals.position_noise, width, rate, order=2) ** 2
        chosen = rows[:: max(len(rows) // POSES, 1)]
        change = _by_acceleration(robot, signals.position[chosen])
        weights = acceleration * ~signals.standing[chosen]
        scaled = (change * np.sqrt(weights)[:, None, :, None]).swapaxes(0, 1)
        scaled = scaled.reshape(len(scaled), -1, change.shape[-1])
        columns = scaled.swapaxes(1, 2) @ scaled * (len(rows) / len(chosen))
        return cls(effort, repeated * effort, columns, float(len(rows)))

    def __add__(self, other: SensorNoise) -> SensorNoise:
        return SensorNoise(
            self.effort + other.effort,
            self.alike + other.alike,
            self.columns + other.columns,
            self.count + other.count,
        )

    def variance(self, joint: int, coefficients: np.ndarray) -> float:
        """Variance of a joint's residual from the sensors alone [N²·m²], for its coefficients of bodies and armature, (k,)."""
        return float(self.effort[joint] + coefficients @ self.columns[joint] @ coefficients) / self.count

    def correlation(self, joint: int, coefficients: np.ndarray, variance: float, unexplained: float) -> float:
        """Number of rows of a joint's residual that count as one independent row.

        Sensor noise counts with its known correlation, the rest of the variance as unmodelled effects.

        Args:
            coefficients: of the joint's bodies and armature, (k,).
            variance: of the residual [N²·m²].
            unexplained: rows that count as one where the model lacks something.
        """
        known, alike = self.variance(joint, coefficients), self.alike[joint] / self.count
        by_motion = max(known - self.effort[joint] / self.count, 0.0)
        # a variance from so few independent rows is that much too large by chance
        chance = CHANCE * np.sqrt(2.0 * self.alike[joint] / max(self.effort[joint] * self.count, 1e-300))
        share = min(variance / max(known, 1e-300), 1.0 + chance)
        lack = variance - share * known
        return float(max((share * (alike + by_motion) + unexplained * lack) / variance, 1.0))


def _by_acceleration(robot: Robot, position: np.ndarray) -> np.ndarray:
    """Derivative of the columns of bodies and armature by the accelerations, (N, n, n, k): joint, moved joint."""
    count, width = position.shape
    moved = np.concatenate([np.zeros((1, width)), np.eye(width)])
    still = np.zeros((count * len(moved), width))
    asked = np.repeat(position, len(moved), axis=0), still, np.tile(moved, (count, 1))
    found = robot.regressor(*asked).reshape(count, len(moved), width, -1)
    result = np.zeros((count, width, width, found.shape[-1] + 1))
    result[..., :-1] = (found[:, 1:] - found[:, :1]).swapaxes(1, 2)
    joints = np.arange(width)
    result[:, joints, joints, -1] = 1.0
    return result
