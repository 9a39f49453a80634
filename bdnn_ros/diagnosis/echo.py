"""Noise of the effort in columns that are made from the effort itself."""

from __future__ import annotations

import numpy as np

from bdnn_ros.diagnosis.noise import ORDER, predicting
from bdnn_ros.effects.motion import Motion


class Echo:
    """How noise of the effort is heard in the second derivative of its slow part.

    Args:
        rows: samples of the motion that a regression keeps, (R,) int.
    """

    def __init__(self, motion: Motion, rows: np.ndarray) -> None:
        self._motion, self._rows = motion, rows
        noise = np.random.default_rng(0).standard_normal((len(motion.time), 1))
        self._noise = motion.signals.smooth(motion.signals.soften(noise))
        self._weights = predicting(self._noise[rows, 0])
        self._heard: dict[float, float] = {}

    def curvature(self, cutoff: float) -> float:
        """Correlation of whitened noise with the second derivative of its slow part [1/s²]: minus a mean square frequency.

        Args:
            cutoff: of the low-pass that leaves the slow part [Hz].
        """
        if cutoff not in self._heard:
            slow = self._motion.signals.passed(self._noise, cutoff)
            bent = self._motion.derivative(self._motion.derivative(slow))
            heard, noise = (self._white(values[self._rows, 0]) for values in (bent, self._noise))
            self._heard[cutoff] = float(heard @ noise / (noise @ noise))
        return self._heard[cutoff]

    def _white(self, values: np.ndarray) -> np.ndarray:
        """Rows (R,) less what those before them tell of white noise behind the low-pass, (R - ORDER,)."""
        past = (a * values[ORDER - lag : len(values) - lag] for lag, a in enumerate(self._weights, start=1))
        return np.asarray(values[ORDER:] - sum(past))
