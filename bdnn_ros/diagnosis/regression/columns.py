"""Columns of terms along one estimate of the load and the bodies, as rows of a regression."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bdnn_ros.diagnosis.regression.decimation import Decimation
from bdnn_ros.diagnosis.regression.pushing import Pushing
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.effects.environment import Push, window
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.rigid import slots


@dataclass(frozen=True)
class Columns:
    """Columns of terms, each made once.

    Attributes:
        motion: the motion at the working rate, with the current estimates of the robot and of the load.
        decimation: makes rows of its values.
    """

    motion: Motion
    decimation: Decimation
    _made: dict[Term, np.ndarray] = field(default_factory=dict)
    _pushing: dict[tuple[int, str | None], Pushing] = field(default_factory=dict)

    def along(self, motion: Motion) -> Columns:
        """Columns by another estimate of load and bodies along the same motion; those that do not depend on it are kept."""
        bodies = motion.robot is not self.motion.robot
        kept = {
            term: made
            for term, made in self._made.items()
            if not (term.effect.of_load or (term.effect.of_bodies and bodies))
        }
        return Columns(motion, self.decimation, kept, self._pushing)

    def of(self, term: Term) -> np.ndarray:
        """Columns of a term, (R, n, k) [N·m per unit]."""
        if term not in self._made:
            self._made[term] = self.fresh(term)
        return self._made[term]

    def fresh(self, term: Term, motion: Motion | None = None) -> np.ndarray:
        """As `of`, computed anew and not cached; of a motion with another load estimate, if given."""
        effect, shape = term.effect, dict(term.shape)
        added = effect.inertials(self.motion.robot, shape, term.link) if term.link else None
        if added is not None:
            return self.of_body(*added)
        if isinstance(effect, Push):
            return self.pushed(term, window(self.motion, shape), effect.mixing(shape))
        columns = effect.columns(motion or self.motion, term.target, shape, term.link)
        return self.decimation.as_rows(columns, borne=not effect.at_sensor)

    def pushed(self, term: Term, weight: np.ndarray, mixing: np.ndarray) -> np.ndarray:
        """Columns of a push with a time window (N,) and mixed as in `Push.mixing`, (K, k), as rows (R, n, k)."""
        effect, place = term.effect, (term.target, term.link)
        assert isinstance(effect, Push)
        if self.decimation.lead:
            whole = weight[:, None, None] * (effect.pulls(self.motion, *place) @ mixing)
            return self.decimation.as_rows(whole)
        if place not in self._pushing:
            self._pushing[place] = self.decimation.pushing(effect.pulls(self.motion, *place))
        return self._pushing[place].at(weight, mixing)

    def of_body(self, body: int, added: np.ndarray) -> np.ndarray:
        """Columns of additions to a body's inertial parameters (PER_LINK, k), (R, n, k) [N·m per unit]."""
        return np.asarray(self.decimation.regressor[:, :, slots(body)] @ added)
