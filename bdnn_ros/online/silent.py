"""Joints whose driver reports no effort while that of the others comes."""

from __future__ import annotations

import numpy as np

PATIENCE = 300
"""A joint that never had an effort is without a sensor after so many messages that lack it: a driver may start late."""


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
        self._waited = np.zeros(count, int)
        self._all_came = False

    def fill(self, effort: np.ndarray, places: np.ndarray) -> None:
        """Put zero, as from a recording, for joints without a sensor; what is NaN then should have been measured.

        Args:
            effort: of one message, (m,), NaN where it says none.
            places: of its joints among the n, (m,).
        """
        if self._all_came:
            return
        unknown = np.isnan(effort)
        if unknown.all():
            return
        self._came[places[~unknown]] = True
        self._all_came = bool(self._came.all())
        self._waited[places[unknown]] += 1
        self.joints = ~self._came & (self._waited > PATIENCE)
        effort[unknown & self.joints[places]] = 0.0
