"""Whitening of rows by a noise model, each by the usable rows just before it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.diagnosis.regression.noise import ORDER, Noise, past, whitened

ALL = slice(None)


class Whitening:
    """Whitening of rows of which some are usable.

    Args:
        usable: rows that count now, (R, n) bool.
        sticking_doubt: see `Rows`, (R, n).
        runs: rows of each gap-free piece.
    """

    def __init__(self, usable: np.ndarray, sticking_doubt: np.ndarray, runs: Sequence[slice]) -> None:
        self.usable, self._sticking_doubt, self._runs = usable, sticking_doubt, runs
        self._pasts: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        self._last: tuple[Noise, tuple[np.ndarray, np.ndarray]] | None = None

    def of(
        self, values: np.ndarray, noise: Noise, joints: np.ndarray | slice = ALL, rows: slice = ALL
    ) -> np.ndarray:
        """Values (R, n, ...) of some joints in units of their noise, as if zero before the first row; zero in unusable rows."""
        if self._last is None or self._last[0] is not noise:
            self._last = noise, noise.whitening(*self._past(noise.order))
        return whitened(values, *(each[rows][:, joints] for each in self._last[1]))

    def log_scale(self, noise: Noise) -> float:
        """Sum of the logarithms of the usable rows' noise: what whitening by it adds to a log likelihood, negative."""
        history, doubt = self._past(noise.order)
        return float(np.sum((history >= 0) * np.log(noise.of(doubt, np.maximum(history, 0)))))

    def history(self, order: int = ORDER) -> np.ndarray:
        """Number of usable rows directly before each, at most the order, (R, n); -1 for an unusable row."""
        return self._past(order)[0]

    def recent_sticking_doubt(self, order: int = ORDER) -> np.ndarray:
        """Largest doubt within each row and its noise history, (R, n)."""
        return self._past(order)[1]

    def full(self) -> np.ndarray:
        """Rows whose noise history is usable throughout, (R, n) bool."""
        return self.history() == ORDER

    def _past(self, order: int) -> tuple[np.ndarray, np.ndarray]:
        if order not in self._pasts:
            self._pasts[order] = past(self.usable, self._sticking_doubt, self._runs, order)
        return self._pasts[order]
