"""What a diagnosis is told of: what was found, and how far either model is off where nothing was fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bdnn_ros.diagnosis.judging.attempt import Attempt
from bdnn_ros.diagnosis.judging.posterior import Estimate
from bdnn_ros.diagnosis.pushes.pushes import at_an_end, throughout
from bdnn_ros.diagnosis.recorded.compared import Compared
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.gains import by_links, rms, share_of, squares
from bdnn_ros.diagnosis.search.leads import parted
from bdnn_ros.diagnosis.telling.unexplained import Remainder
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

USUAL_LINK_ERROR = 0.1
"""Spread of the links' relative errors that any description may have."""
EXPLAINED = 1.3
"""An extended model within this factor of the noise floor explains the recording."""

LOUD, MORE_THAN_NOISE = 0.1, 5.0
"""What is left is no sensor's noise beyond this share of the effort's spread and so many times its noise; see `Case.floor`."""


@dataclass(frozen=True)
class Case:
    """Recordings with what was found in them; errors are of rows that the search has not seen.

    Attributes:
        found: the chosen terms' estimates from all rows, in the order of the attempt's.
        remainder: what all of them leave.
        since: the earlier model that takes the simulation's place, if one does.
    """

    recordings: Sequence[Recording]
    robot: Robot
    equations: Equations
    attempt: Attempt
    found: Sequence[Estimate]
    remainder: Remainder
    since: Compared | None = None

    @cached_property
    def held(self) -> np.ndarray:
        """Rows that errors are of, (R, n) bool."""
        return np.asarray(self.equations.usable & self.attempt.test[:, None])

    @cached_property
    def simulation(self) -> np.ndarray:
        """The simulation's error, root mean square of each joint, (n,) [N·m]."""
        return rms(self.equations.target, self.held)

    @cached_property
    def extended(self) -> np.ndarray:
        """The extended model's, (n,) [N·m]."""
        return rms(self.attempt.extended, self.held)

    @cached_property
    def floor(self) -> np.ndarray:
        """The noise's, at most the extended model's, (n,) [N·m].

        Much that looks like noise is none where the effort's own noise is far less: something acts that nothing predicts.
        """
        floor, own = np.maximum(self.remainder.floor, 0.0), self._own_noise
        loud = (floor > LOUD * self.equations.effort_scale) & (floor > MORE_THAN_NOISE * own)
        return np.asarray(np.minimum(np.where(loud, own, floor), self.extended))

    @property
    def _own_noise(self) -> np.ndarray:
        """What is faster than the motion of each joint's effort, by its share of all frequencies, (n,) [N·m]."""
        signals = self.equations.motion.signals
        assert signals.effort is not None
        quick = (signals.effort - signals.smooth(signals.effort))[self.equations.rows]
        beyond = (signals.flat or signals.rate / 2.0) - signals.cutoff
        return np.asarray(quick.std(axis=0) * np.sqrt(signals.cutoff / max(beyond, signals.cutoff)))

    def near(self, error: np.ndarray) -> np.ndarray:
        """Whether each joint's error [N·m] is near its floor, or too small a share of its effort to matter, (n,) each."""
        return np.asarray((error <= EXPLAINED * self.floor) | (error <= 0.02 * self.equations.effort_scale))

    @property
    def left(self) -> np.ndarray:
        """What the extended model leaves above the noise, squared, (n,) [(N·m)²]."""
        return np.asarray(self.extended**2 - self.floor**2)

    @property
    def told(self) -> np.ndarray:
        """What is left above the noise of joints where inputs predict it, squared, (n,) [(N·m)²]."""
        joints = self.equations.motion.signals.joints
        return self.left * np.array([joint in self.remainder.inputs for joint in joints])

    @property
    def share_left(self) -> float:
        """Part of the simulation's squared error that the extended model leaves above the noise."""
        return max(self._share(self.left), 0.0)

    @cached_property
    def by_links(self) -> float:
        """Part of the simulation's squared error that the links' corrections remove."""
        return by_links(self.equations, self.attempt.fitted, self.held)

    @cached_property
    def lead(self) -> float:
        """How far efforts lead the motion in the extended model, which is no finding [s]."""
        return parted(self.attempt.fitted, self.attempt.fitted.whole)[0]

    @cached_property
    def by_lead(self) -> float:
        """Part of the simulation's squared error that this lead removes."""
        part = self.equations.nuisances[:, :, 0] * self.lead
        return share_of(part, self.attempt.fitted.left(), self.equations.target, self.held)

    @property
    def stays(self) -> bool:
        """Whether all corrections were given up: errors are those of what was compared with; see `harmless`."""
        return not (self.found or self.attempt.fitted.whole.coefficients.any())

    @property
    def gained(self) -> float:
        """Part of the simulation's squared error that the extended model removes."""
        return 1.0 - self._share(self.extended**2)

    def _share(self, squared: np.ndarray) -> float:
        """Mean squared errors of the joints (n,) as a part of the simulation's."""
        return squares(squared, self.held) / max(squares(self.simulation**2, self.held), 1e-30)

    @property
    def far_off(self) -> bool:
        """Whether the links are further off than usual."""
        return self.attempt.fitted.link_error > USUAL_LINK_ERROR

    @cached_property
    def at_ends(self) -> set[int]:
        """Terms that push in the first or last moments only."""
        every = range(len(self.found))
        return {one for one in every if at_an_end(self.attempt.fitted, every, one)}

    @cached_property
    def always(self) -> set[int]:
        """Terms that push nearly always when a joint moves that shows it."""
        every = range(len(self.found))
        return {one for one in every if throughout(self.attempt.fitted, every, one)}
