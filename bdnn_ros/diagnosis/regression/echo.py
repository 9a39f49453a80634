"""Noise of the effort in columns that are made from the effort itself."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from bdnn_ros.diagnosis.regression.noise import ORDER
from bdnn_ros.effects.motion import Motion

LEAST = 1e-3
"""Noise changes by too little to be told where less of its curvature is taken away, per its size."""


class Echo:
    """How noise of the effort is heard in the second derivative of its slow part.

    The noise wanders for about as long as the signals' low-pass lasts, as that of currents does: of white noise less is heard,
    of what is slower no more.

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
            self._heard[key] = float(np.log(self._size / self._innovation(left))) / taken
        return self._heard[key]

    def _curvature(self, cutoff: float) -> np.ndarray:
        if cutoff not in self._bent:
            slow = self._motion.signals.passed(self._noise, cutoff)
            self._bent[cutoff] = self._motion.derivative(self._motion.derivative(slow))
        return self._bent[cutoff]

    def _innovation(self, values: np.ndarray) -> float:
        """What those rows before them do not tell of values (N, 1)."""
        each = [values[self._rows[run], 0] for run in self._runs]
        past = np.concatenate([_past(one) for one in each])
        now = np.concatenate([one[ORDER:] for one in each])
        return float(np.std(now - past @ np.linalg.lstsq(past, now, rcond=None)[0]))


def _past(values: np.ndarray) -> np.ndarray:
    """The values just before each of some that have as many, (R - ORDER, ORDER) of (R,)."""
    count = max(len(values) - ORDER, 0)
    return np.stack([values[ORDER - lag :][:count] for lag in range(1, ORDER + 1)], axis=1)
