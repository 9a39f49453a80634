"""Coloured noise of the joints' residuals: autoregressive, larger where a joint may stick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

ORDER = 3
"""Order of the autoregressive noise model."""
SLIPS = (0.5, 500.0, 31)
"""Smallest and largest noise of a joint that may stick, relative to its other noise, and the number of grid points."""


@dataclass(frozen=True)
class Noise:
    """Autoregressive noise of each joint: e[k] = sum_i a[j, i] e[k-i] + std[j] · white.

    Attributes:
        coefficients: a, (n, order).
        std: where the joint surely moves, (n,) [N·m].
        slip: standard deviation per unit of doubt that is added where it may stick, (n,) [N·m]; None for none.
    """

    coefficients: np.ndarray
    std: np.ndarray
    slip: np.ndarray | None = None

    @property
    def order(self) -> int:
        """Order of the autoregression."""
        return int(self.coefficients.shape[1])

    def of(self, doubt: np.ndarray, history: np.ndarray) -> np.ndarray:
        """Standard deviation of rows given their usable history, (R, n).

        Args:
            doubt: of the joint's direction, (R, n).
            history: usable rows just before each, up to the order, (R, n).
        """
        std = self.std if self.slip is None else np.hypot(self.std, self.slip * doubt)
        return np.asarray(std * self._shorter[1][history, self._all])

    def sure(self, doubt: np.ndarray) -> np.ndarray:
        """Rows in which possible sticking adds less than the other noise, (R, n) bool, given the doubt (R, n)."""
        return np.ones(doubt.shape, bool) if self.slip is None else self.slip * doubt <= self.std

    def weights(self, history: np.ndarray) -> np.ndarray:
        """Weights of the preceding rows in the best prediction, zero beyond the usable history, (R, n, order); see `of`."""
        return np.asarray(self._shorter[0][history, self._all])

    def whitening(self, history: np.ndarray, doubt: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Prediction weights, and inverse standard deviations (R, n), zero in unusable rows; both for `whitened`.

        Args:
            history, doubt: as in `past`, (R, n).
        """
        seen = np.maximum(history, 0)
        return self.weights(seen), (history >= 0) / self.of(doubt, seen)

    @property
    def _all(self) -> np.ndarray:
        return np.arange(len(self.std))

    @cached_property
    def _shorter(self) -> tuple[np.ndarray, np.ndarray]:
        """Best predictors from 0, 1 ... order rows, (order + 1, n, order), and their errors relative to `std`, (order + 1, n).

        Levinson's recursion downwards: the same noise with less of its past usable.
        """
        joints, order = self.coefficients.shape
        weights, errors = np.zeros((order + 1, joints, order)), np.ones((order + 1, joints))
        weights[order] = self.coefficients
        for p in range(order, 0, -1):
            known, last = weights[p, :, : p - 1], weights[p, :, p - 1 : p]
            left = 1.0 - last**2
            weights[p - 1, :, : p - 1] = (known + last * known[:, ::-1]) / left
            errors[p - 1] = errors[p] / np.sqrt(left[:, 0])
        return weights, errors


def whitened(values: np.ndarray, weights: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """Values (R, k, ...) in units of their noise, with `Noise.whitening` of the same rows and joints."""
    shape = values.shape[:2] + (1,) * (values.ndim - 2)
    white = values.astype(float)
    for lag in range(1, weights.shape[2] + 1):
        white[lag:] -= weights[lag:, :, lag - 1].reshape(len(values[lag:]), *shape[1:]) * values[:-lag]
    white *= keep.reshape(shape)
    return white


def past(
    usable: np.ndarray, doubt: np.ndarray, runs: Sequence[slice], order: int
) -> tuple[np.ndarray, np.ndarray]:
    """Number of usable rows directly before each, up to the order, -1 for unusable rows; and the largest doubt among them.

    Args:
        usable, doubt: of rows, (R, n), as both results are.
        runs: rows of each gap-free piece.
    """
    row = np.arange(len(usable))[:, None]
    begun = np.where(usable, 0, row + 1)
    starts = [run.start for run in runs]
    begun[starts] = np.maximum(begun[starts], row[starts])
    length = np.minimum(row - np.maximum.accumulate(begun, axis=0), order)
    doubtful = doubt.copy()
    for run in runs:
        for lag in range(1, order + 1):
            later = doubtful[run.start + lag : run.stop]
            np.maximum(later, doubt[run.start : max(run.stop - lag, run.start)], out=later)
    return np.where(usable, length, -1), doubtful


def stable(a: np.ndarray) -> np.ndarray:
    """Autoregressive coefficients with every pole moved inside radius 0.98."""
    poles = np.roots(np.concatenate([[1.0], -a]))
    radius = np.abs(poles)
    if (radius <= 0.98).all():
        return a
    poles = np.where(radius > 0.98, poles * 0.98 / np.maximum(radius, 1e-12), poles)
    return np.asarray(-np.real(np.poly(poles))[1:])


def slipping(values: np.ndarray, doubt: np.ndarray, std: float) -> float:
    """Likeliest noise per doubt of values (R,), given the standard deviation of their other noise; searched on a grid."""
    if not len(values):
        return 0.0
    tried = std * np.concatenate([[0.0], np.geomspace(*SLIPS)]) / max(float(doubt.max()), 1e-12)
    variance = std**2 + np.outer(tried**2, doubt**2)
    return float(tried[np.argmin(np.sum(np.log(variance) + values**2 / variance, axis=1))])


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def moving_time(rows: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Duration of each joint's motion, (n,) [s], from its usable rows (R, n) bool and their times (R,) [s]."""
    return np.asarray(rows.sum(axis=0) * np.median(np.diff(time)))
