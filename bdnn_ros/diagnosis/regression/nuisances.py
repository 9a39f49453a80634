"""Columns that are never findings: how far the effort leads, what blurs it, and how joints stick and creep."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from bdnn_ros.diagnosis.regression.decimation import Decimation
from bdnn_ros.diagnosis.regression.onset import onset_columns, onset_spread
from bdnn_ros.effects.motion import Motion

STICKING_LEAD = 0.003
"""How far dry friction may lead the direction of a joint that sticks, where friction is all of the effort [s]."""
BLURS = slice(1, 3)
"""Nuisance columns that blur the effort; before them comes the lead, after them sticking and creeping of the joints."""


class Nuisances:
    """A lead, two blurs, sticking of each of n joints, and creep of k joints.

    Lead: the load's rate, as a held effort leads. Blurs: the load's curvature, as of slow sensors, and that of the bodies'
    effort beyond the motion's frequencies, against noise of the position. Sticking: rates of the directions, as friction of a
    joint that sticks turns before its low-passed velocity. Creep: see `onset_columns`. The last three kinds hold for any
    estimate of the load.
    """

    def __init__(self, decimation: Decimation) -> None:
        self._decimation, self._simulated = decimation, decimation.simulated
        self._last: tuple[Motion, np.ndarray] | None = None

    def along(self, motion: Motion) -> np.ndarray:
        """The columns by an estimate of the load along the same motion, (R, n, 3 + n + k); cached for the next call."""
        if self._last is None or self._last[0] is not motion:
            rate = motion.load_rate
            general = np.stack([rate, motion.derivative(rate)], axis=-1)
            by_load = self._decimation.as_rows(general, borne=False)
            self._last = motion, np.concatenate([by_load, *self._steady], axis=2)
        return self._last[1]

    def spread(self, effort_scale: np.ndarray) -> np.ndarray:
        """Prior standard deviations of lead [s], blurs [s²], sticking [N·m·s] and creep [N·m], (3 + n + k,).

        Args:
            effort_scale: spread of each joint's effort, (n,) [N·m].
        """
        blur = self._simulated.signals.kernel_std**2
        more = onset_spread(self._simulated.signals, self._simulated.robot, effort_scale)
        return np.array([0.5 * self.hold, blur, blur, *(STICKING_LEAD * effort_scale), *more])

    @property
    def hold(self) -> float:
        """Lead of an effort command that is held for a sample [s], half a period; an average over a sample lags by as much."""
        return 0.5 / self._simulated.signals.raw_rate

    @property
    def sticking(self) -> slice:
        """The columns of the joints' sticking."""
        return slice(BLURS.stop, BLURS.stop + self._simulated.signals.width)

    @cached_property
    def _steady(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Columns that no estimate of the load changes: jitter, sticking and creep."""
        creeping = onset_columns(self._simulated.signals, self._decimation.as_rows)
        return self._jitter(), self._sticking(), creeping

    def _jitter(self) -> np.ndarray:
        """Curvature of the part of the bodies' effort that is faster than the motion, (R, n, 1) [N·m/s²]."""
        motion = self._simulated
        fast = motion.link_load - motion.calmed(motion.link_load)
        return self._decimation.as_rows(motion.derivative(motion.derivative(fast)))[..., None]

    def _sticking(self) -> np.ndarray:
        """Rates of the joints' directions of motion, (R, n, n) [1/s]."""
        motion = self._simulated
        rate = self._decimation.as_rows(motion.derivative(motion.signals.sign))
        return np.asarray(rate[:, :, None] * np.eye(motion.signals.width))
