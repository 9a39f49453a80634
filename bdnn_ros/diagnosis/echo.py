"""Noise of the effort in columns that are made from the effort itself."""

from __future__ import annotations

import numpy as np

from bdnn_ros.diagnosis.noise import ORDER, predicting
from bdnn_ros.effects.motion import Motion

LEAST = 1e-3
"""Noise changes by too little to be told where less of its curvature is taken away, per its size."""


class Echo:
    """How noise of the effort is heard in the second derivative of its slow part.

    Args:
        rows: samples of the motion that a regression keeps, (R,) int.
    """

    def __init__(self, motion: Motion, rows: np.ndarray) -> None:
        self._motion, self._rows = motion, rows
        noise = np.random.default_rng(0).standard_normal((len(motion.time), 1))
        self._noise = motion.signals.smooth(motion.signals.soften(noise))
        self._size = _innovation(self._noise[rows, 0])
        self._bent: dict[float, np.ndarray] = {}
        self._heard: dict[tuple[float, float], float] = {}

    def heard(self, cutoff: float, taken: float) -> float:
        """Nats a row, per second squared, that the noise itself seems to gain where some of its bend is taken from it.

        What is left of noise that was filtered is foretold better from what was before: by the mean logarithm of the filter's
        gain (Kolmogorov and Szegő), which is the determinant of the change of variables from the one to the other.

        Args:
            cutoff: of the low-pass that leaves the slow part [Hz].
            taken: how much of its second derivative is [s²].
        """
        taken = max(taken, LEAST / (2.0 * np.pi * cutoff) ** 2)
        key = (cutoff, taken)
        if key not in self._heard:
            left = self._noise + taken * self._curvature(cutoff)
            self._heard[key] = float(np.log(self._size / _innovation(left[self._rows, 0]))) / taken
        return self._heard[key]

    def _curvature(self, cutoff: float) -> np.ndarray:
        if cutoff not in self._bent:
            slow = self._motion.signals.passed(self._noise, cutoff)
            self._bent[cutoff] = self._motion.derivative(self._motion.derivative(slow))
        return self._bent[cutoff]


def _innovation(values: np.ndarray) -> float:
    """What those before them do not tell of values (R,)."""
    weights = predicting(values)
    past = sum(a * values[ORDER - lag : len(values) - lag] for lag, a in enumerate(weights, start=1))
    return float(np.std(values[ORDER:] - past))
