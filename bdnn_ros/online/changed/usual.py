"""The usual residual of each joint under the model in service, while the joint moves."""

from __future__ import annotations

from collections import deque

import numpy as np

ENOUGH = 5
"""Chunks in which a joint moved, without suspicion, before a change can be told from learning."""
REMEMBERED = 20
"""Chunks whose residual says what is usual."""
AMONG = 0.9
"""No more than usual is what is left in so many of them: slow motion leaves less than fast motion does."""
LOUD = 0.75
"""A moment in which something may have changed is taken to leave what so many of them stay within."""
MOVES = 0.25
"""A joint moves in a chunk where it does so for this share of it: while it rests dry friction may hold anything."""
LEAST = 1e-4
"""Smallest residual, per effort scale."""
UNKNOWN = 1e3
"""Noise of a joint of which nothing is usual yet, per effort scale: it tells nothing."""
CORRELATION = (3.0, 30.0)
"""Rows that say as much as one independent row: least (the low-pass alone) and most."""


class Usual:
    """Statistics of the usual residual of each joint.

    Args:
        scale: of each joint's effort, (n,) [N·m].
    """

    def __init__(self, scale: np.ndarray) -> None:
        self._scale = scale
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._squared = [deque[float](maxlen=REMEMBERED) for _ in self._scale]
        self._correlation = [deque[float](maxlen=REMEMBERED) for _ in self._scale]

    def take(self, residual: np.ndarray, rests: np.ndarray) -> None:
        """Add a chunk: its residual (R, n) [N·m], and where each joint rests, (R, n) bool."""
        squared, correlation = np.mean(residual**2, axis=0), correlated(residual)
        for joint in np.flatnonzero((~rests).mean(axis=0) >= MOVES):
            self._squared[joint].append(float(squared[joint]))
            self._correlation[joint].append(float(correlation[joint]))

    @property
    def known(self) -> np.ndarray:
        """Joints with enough chunks to say what is usual, (n,) bool."""
        return np.array([len(each) >= ENOUGH for each in self._squared])

    @property
    def level(self) -> np.ndarray:
        """Upper limit of the usual squared residual of each joint, (n,) [N²·m²]."""
        return self._squared_within(AMONG)

    @property
    def noise(self) -> np.ndarray:
        """Standard deviation of one row, widened so that rows may be treated as independent, (n,) [N·m]."""
        return self._noise_within(0.5)

    @property
    def loud(self) -> np.ndarray:
        """The same for a moment with a suspiciously large residual, (n,) [N·m]: a moment says less than minutes do."""
        return self._noise_within(LOUD)

    def _noise_within(self, share: float) -> np.ndarray:
        correlation = [np.median(each) if len(each) else CORRELATION[1] for each in self._correlation]
        return np.asarray(np.sqrt(self._squared_within(share) * correlation))

    def _squared_within(self, share: float) -> np.ndarray:
        """Squared residual of each joint that is not exceeded in this share of the chunks, (n,) [N²·m²]."""
        levels = [np.quantile(each, share) if len(each) else 0.0 for each in self._squared]
        least, unknown = (LEAST * self._scale) ** 2, (UNKNOWN * self._scale) ** 2
        return np.where(self.known, np.maximum(levels, least), unknown)


def correlated(residual: np.ndarray) -> np.ndarray:
    """Number of rows that count as one independent row, (n,), from the autocorrelation of a chunk (R, n)."""
    r = residual - residual.mean(axis=0)
    power = np.maximum((r**2).sum(axis=0), 1e-300)
    result = np.ones(r.shape[1])
    growing = np.ones(r.shape[1], bool)
    for lag in range(1, len(r) // 2):
        rho = (r[lag:] * r[:-lag]).sum(axis=0) / power
        growing &= rho > 0.05
        if not growing.any():
            break
        result += np.where(growing, 2.0 * rho, 0.0)
    return np.asarray(np.clip(result, *CORRELATION))
