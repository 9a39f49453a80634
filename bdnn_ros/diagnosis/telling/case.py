"""Data that a report is made from: recordings, what was found, and errors of either model on held-out rows."""

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
from bdnn_ros.diagnosis.search.leads import lead_and_delays
from bdnn_ros.diagnosis.telling.unexplained import Remainder
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

USUAL_LINK_ERROR = 0.1
"""Relative link error that any description may have."""
SLIGHT = 0.1
"""Share of the squared error that unnamed corrections must surely remove to be worth a note."""
MOST = 0.5
"""Share of the squared error above which link corrections get a note, and unnamed terms leave a verdict open."""
EXPLAINED = 1.3
"""Largest ratio of the extended model's error to the noise floor at which the recording is explained."""

LOUD, MORE_THAN_NOISE = 0.1, 5.0
"""A floor above this share of the effort's spread and this many times its fast noise is no sensor noise; see `Case.floor`."""


@dataclass(frozen=True)
class Case:
    """Recordings with what was found in them; errors are on held-out rows.

    Attributes:
        found: the chosen terms' estimates from all rows, in the order of the attempt's.
        remainder: their residual.
        earlier: the earlier model that takes the simulation's place, if one does.
    """

    recordings: Sequence[Recording]
    robot: Robot
    equations: Equations
    attempt: Attempt
    found: Sequence[Estimate]
    remainder: Remainder
    earlier: Compared | None = None

    @cached_property
    def held(self) -> np.ndarray:
        """Held-out rows, (R, n) bool."""
        return np.asarray(self.equations.usable & self.attempt.test[:, None])

    @cached_property
    def simulation(self) -> np.ndarray:
        """Root mean square error of the simulation at each joint, (n,) [N·m]."""
        return rms(self.equations.rows.target, self.held)

    @cached_property
    def extended(self) -> np.ndarray:
        """Root mean square error of the extended model at each joint, (n,) [N·m]."""
        return rms(self.attempt.extended, self.held)

    @cached_property
    def floor(self) -> np.ndarray:
        """Noise floor of each joint, at most the extended model's error, (n,) [N·m].

        A large unpredictable residual is no noise where the effort's own fast noise is far smaller: something else acts.
        """
        floor, own = np.maximum(self.remainder.floor, 0.0), self._own_noise
        loud = (floor > LOUD * self.equations.rows.effort_scale) & (floor > MORE_THAN_NOISE * own)
        return np.asarray(np.minimum(np.where(loud, own, floor), self.extended))

    @property
    def _own_noise(self) -> np.ndarray:
        """Noise of each joint's effort behind the low-pass, estimated from its content above the cut-off, (n,) [N·m]."""
        signals = self.equations.motion.signals
        assert signals.effort is not None
        quick = (signals.effort - signals.smooth(signals.effort))[self.equations.rows.samples]
        beyond = (signals.flat or signals.rate / 2.0) - signals.cutoff
        return np.asarray(quick.std(axis=0) * np.sqrt(signals.cutoff / max(beyond, signals.cutoff)))

    def near(self, error: np.ndarray) -> np.ndarray:
        """Whether each joint's error [N·m] is near its floor, or a negligible share of its effort, (n,) each."""
        return np.asarray(
            (error <= EXPLAINED * self.floor) | (error <= 0.02 * self.equations.rows.effort_scale)
        )

    @property
    def left(self) -> np.ndarray:
        """Squared error of the extended model above the noise, (n,) [(N·m)²]."""
        return np.asarray(self.extended**2 - self.floor**2)

    @property
    def predictable(self) -> np.ndarray:
        """The same at joints where inputs predict it, zero elsewhere, (n,) [(N·m)²]."""
        joints = self.equations.motion.signals.joints
        return self.left * np.array([joint in self.remainder.inputs for joint in joints])

    @property
    def share_left(self) -> float:
        """Share of the simulation's squared error that the extended model leaves above the noise."""
        return max(self._share(self.left), 0.0)

    @cached_property
    def by_links(self) -> float:
        """Share of the simulation's squared error that the link corrections remove."""
        return by_links(self.equations, self.attempt.fitted, self.held)

    @cached_property
    def lead(self) -> float:
        """Lead of efforts over the motion in the extended model, which is no finding [s]."""
        return lead_and_delays(self.attempt.fitted, self.attempt.fitted.whole)[0]

    @cached_property
    def by_lead(self) -> float:
        """Share of the simulation's squared error that this lead removes."""
        part = self.equations.nuisances.along(self.equations.motion)[:, :, 0] * self.lead
        return share_of(part, self.attempt.fitted.residual_of_all(), self.equations.rows.target, self.held)

    @property
    def stays(self) -> bool:
        """Whether all corrections were dropped, so that errors are those of the reference; see `without_harm`."""
        return not (self.found or self.attempt.fitted.whole.coefficients.any())

    @property
    def gained(self) -> float:
        """Share of the simulation's squared error that the extended model removes."""
        return 1.0 - self._share(self.extended**2)

    def _share(self, squared: np.ndarray) -> float:
        """Mean squared errors of the joints (n,) as a share of the simulation's."""
        return squares(squared, self.held) / max(squares(self.simulation**2, self.held), 1e-30)

    @property
    def far_off(self) -> bool:
        """Whether the links are further off than usual."""
        return self.attempt.fitted.link_error > USUAL_LINK_ERROR

    @cached_property
    def at_ends(self) -> set[int]:
        """Pushes in the first or last moments of a recording only."""
        every = range(len(self.found))
        return {one for one in every if at_an_end(self.attempt.fitted, every, one)}

    @cached_property
    def always(self) -> set[int]:
        """Pushes that act nearly always when a joint moves that shows them."""
        every = range(len(self.found))
        return {one for one in every if throughout(self.attempt.fitted, every, one)}
