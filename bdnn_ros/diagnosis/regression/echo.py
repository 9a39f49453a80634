"""Correction for columns that are made from the measured effort: they contain its noise."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from bdnn_ros.diagnosis.regression.noise import ORDER
from bdnn_ros.effects.motion import Motion

LEAST = 1e-3
"""Smallest removed curvature that is evaluated, in units of (2 π cut-off)⁻²: less changes noise by too little."""


class Echo:
    """Evidence that noise of the effort seems to gain from columns with the curvature (second derivative) of its slow part.

    The noise is simulated with a correlation time of the signals' low-pass, as of motor currents: white noise gains less,
    slower noise no more.

    Args:
        rows: samples of the motion that a regression keeps, (R,) int.
        runs: rows of each gap-free piece.
    """

    def __init__(self, motion: Motion, rows: np.ndarray, runs: Sequence[slice]) -> None:
        self._motion, self._rows, self._runs = motion, rows, runs
        stays = np.exp(-2.0 * np.pi * motion.signals.cutoff / motion.signals.rate)
        white = np.random.default_rng(0).standard_normal(len(motion.time)).tolist()
        noise = np.array([*accumulate(white, lambda before, new: stays * before + new)])[:, None]
        self._noise = motion.signals.smooth(motion.signals.soften(noise))
        self._size = self._innovation(self._noise)
        self._bent: dict[float, np.ndarray] = {}
        self._heard: dict[tuple[float, float], float] = {}

    def heard(self, cutoff: float, taken: float) -> float:
        """Apparent gain in nats per row and s² when an amount of the noise's curvature is removed from it.

        Filtered noise is predicted better from its past by the mean logarithm of the filter's gain (Kolmogorov and Szegő),
        which is the determinant of the change of variables between the two.

        Args:
            cutoff: low-pass of the slow part [Hz].
            taken: amount of its second derivative that is removed [s²].
        """
        taken = max(taken, LEAST / (2.0 * np.pi * cutoff) ** 2)
        key = (cutoff, taken)
        if key not in self._heard:
            left = self._noise + taken * self._curvature(cutoff)
            self._heard[key] = float(np.log(self._size / self._innovation(left))) / taken
        return self._heard[key]

    def _curvature(self, cutoff: float) -> np.ndarray:
        if cutoff not in self._bent:
            slow = self._motion.signals.passed(self._noise, cutoff)
            self._bent[cutoff] = self._motion.derivative(self._motion.derivative(slow))
        return self._bent[cutoff]

    def _innovation(self, values: np.ndarray) -> float:
        """Standard deviation of values (N, 1) that the preceding rows do not predict."""
        each = [values[self._rows[run], 0] for run in self._runs]
        past = np.concatenate([_past(one) for one in each])
        now = np.concatenate([one[ORDER:] for one in each])
        return float(np.std(now - past @ np.linalg.lstsq(past, now, rcond=None)[0]))


def _past(values: np.ndarray) -> np.ndarray:
    """The `ORDER` values before each value that has so many, (R - ORDER, ORDER) of (R,)."""
    count = max(len(values) - ORDER, 0)
    return np.stack([values[ORDER - lag :][:count] for lag in range(1, ORDER + 1)], axis=1)
