"""Columns of pushes, made fast: low-passed once for a push that acts all the time, and anew only around its edges.

No other effect is tried at so many times and points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

SETTLED = 1e-12
"""A window's weight is 0 or 1 within this tolerance."""


@dataclass(frozen=True)
class Pushing:
    """Columns of a push at one place, for any time window.

    Attributes:
        pulls: efforts that columns of a push are mixed from, at the joints that feel it, (N, J, K).
        always: the same low-passed as rows, (R, J, K).
        joints: indices of these joints, (J,) int.
        width: number of joints n.
        smoothing: the low-pass at the rows, (R, N).
        rows: samples of the rows, (R,) int.
    """

    pulls: np.ndarray
    always: np.ndarray
    joints: np.ndarray
    width: int
    smoothing: csr_array
    rows: np.ndarray

    @classmethod
    def of(cls, pulls: np.ndarray, smoothing: csr_array, rows: np.ndarray) -> Pushing:
        """The same from the pulls on all joints, (N, n, K)."""
        width, joints = pulls.shape[1], np.flatnonzero(pulls.any(axis=(0, 2)))
        pulls = np.ascontiguousarray(pulls[:, joints])
        always = smoothing @ pulls.reshape(len(pulls), -1)
        return cls(pulls, always.reshape(len(rows), *pulls.shape[1:]), joints, width, smoothing, rows)

    def at(self, weight: np.ndarray, mixing: np.ndarray) -> np.ndarray:
        """Low-passed columns of a window (N,) and mixing (K, k), as rows (R, n, k)."""
        acting = np.zeros((len(self.rows), len(self.joints), mixing.shape[1]))
        changing = (np.abs(weight) > SETTLED) & (np.abs(weight - 1.0) > SETTLED)
        about = self.smoothing @ changing.astype(float) > 0.0
        whole = ~about & (weight[self.rows] > 0.5)
        acting[whole] = self.always[whole] @ mixing
        if about.any():
            part = self.smoothing[np.flatnonzero(about)]
            seen, index = np.unique(part.indices, return_inverse=True)
            narrow = csr_array((part.data, index, part.indptr), shape=(part.shape[0], len(seen)))
            values = weight[seen, None, None] * (self.pulls[seen] @ mixing)
            acting[about] = (narrow @ values.reshape(len(seen), -1)).reshape(-1, *acting.shape[1:])
        result = np.zeros((len(self.rows), self.width, mixing.shape[1]))
        result[:, self.joints] = acting
        return result
