"""Joints without an effort sensor: their effort never comes while others' does, or never changes."""

from __future__ import annotations

import numpy as np

PATIENCE = 10_000_000_000
"""A joint that never had an effort is without a sensor when so long [ns] was lacking: a driver may start late."""
LONGEST_STEP = 1_000_000_000
"""More than this [ns] between two messages is a pause, in which nothing is waited for."""
MOVES = 0.01
"""Where a joint has come so far [rad, m] from where it was, the robot moves: at rest no effort need change."""
LEAST_VARIANCE = 1e-12
"""Of an effort that changes at all [N²·m²]."""


def changes(variance: np.ndarray) -> np.ndarray:
    """Whether efforts of this variance, (n,) [N²·m²], change at all; a constant placeholder is nothing to compare with."""
    return np.asarray(variance > LEAST_VARIANCE)


def relative(squared: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Squared error over the variance of the effort, (n,) each [N²·m²]; NaN where the effort never changes."""
    return np.where(changes(variance), squared / np.maximum(variance, LEAST_VARIANCE), np.nan)


class Silent:
    """Distinguishes joints without an effort sensor from those whose effort is missing now and then.

    Args:
        count: of joints, n.

    Attributes:
        joints: which have no sensor, as their effort never came, (n,) bool.
        still: which have none either, as theirs never changed while the robot moved, (n,) bool.
    """

    def __init__(self, count: int) -> None:
        self.joints = np.zeros(count, bool)
        self.still = np.zeros(count, bool)
        self._came = np.zeros(count, bool)
        self._changed = np.zeros(count, bool)
        self._waited = np.zeros(count, np.int64)
        self._lacked = np.zeros(count, np.int64)
        self._first = np.full((2, count), np.nan)
        self._moves = self._all_changed = False

    def look(self, position: np.ndarray, effort: np.ndarray, places: np.ndarray, stamp: int) -> None:
        """Update with the efforts of one message.

        Args:
            position, effort: of one message, (m,), NaN where it says none.
            places: of its joints among the n, (m,).
            stamp: of the message [ns].
        """
        if self._all_changed:
            return
        unknown = np.isnan(effort)
        if unknown.all():
            return
        first = self._first[:, places]
        self._first[:, places] = first = np.where(np.isnan(first), [position, effort], first)
        away = (position > first[0] + MOVES) | (position < first[0] - MOVES)
        self._moves = self._moves or bool(away.any())
        came, changed = places[~unknown], places[~unknown & (effort != first[1])]
        # what was waited for an effort to come says nothing of one that came and does not change yet
        self._waited[came[~self._came[came]]] = 0
        self._came[came] = True
        self._changed[changed] = True
        self._all_changed = bool(self._changed.all())
        lacking = places[unknown | (self._moves & ~self._changed[places])]
        step = stamp - self._lacked[lacking]
        self._waited[lacking] += np.where((step > 0) & (step <= LONGEST_STEP), step, 0)
        self._lacked[lacking] = stamp
        long = self._waited >= PATIENCE
        self.joints, self.still = ~self._came & long, self._came & ~self._changed & long
