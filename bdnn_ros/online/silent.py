"""Joints whose driver reports no effort while that of the others comes."""

from __future__ import annotations

import numpy as np

PATIENCE = 10_000_000_000
"""A joint that never had an effort is without a sensor when so long [ns] was lacking: a driver may start late."""
LONGEST_STEP = 1_000_000_000
"""More than this [ns] between two messages is a pause, in which nothing is waited for."""


class Silent:
    """Tells a joint without a sensor for its effort from one whose effort is missing now and then.

    Args:
        count: of joints, n.

    Attributes:
        joints: which have no sensor, (n,) bool.
    """

    def __init__(self, count: int) -> None:
        self.joints = np.zeros(count, bool)
        self._came = np.zeros(count, bool)
        self._waited = np.zeros(count, np.int64)
        self._lacked = np.zeros(count, np.int64)
        self._all_came = False

    def look(self, effort: np.ndarray, places: np.ndarray, stamp: int) -> None:
        """Take note of which joints have an effort.

        Args:
            effort: of one message, (m,), NaN where it says none.
            places: of its joints among the n, (m,).
            stamp: of the message [ns].
        """
        if self._all_came:
            return
        unknown = np.isnan(effort)
        if unknown.all():
            return
        self._came[places[~unknown]] = True
        self._all_came = bool(self._came.all())
        lacking = places[unknown]
        step = stamp - self._lacked[lacking]
        self._waited[lacking] += np.where((step > 0) & (step <= LONGEST_STEP), step, 0)
        self._lacked[lacking] = stamp
        self.joints = ~self._came & (self._waited >= PATIENCE)
