"""What is not known of what an identified model's joints may add to the effort of its rigid bodies: learned, or left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bdnn_ros.diagnosis.regression.term import COMMON, Term
from bdnn_ros.effects.registry import get
from bdnn_ros.physical.left_open import LeftOpen
from bdnn_ros.physical.local import LocalResiduals

if TYPE_CHECKING:
    from bdnn_ros.diagnosis.regression.equations import Equations


@dataclass(frozen=True)
class Learned:
    """Errors of the weights of what joints may add.

    Attributes:
        left_open: the weights.
        weights: from U relative errors, as of links and joints, to theirs, (W, U) [N·m].
        load: what bodies ask of joints, (N, n) [N·m], where they may ask more than those of the model, else None.
    """

    left_open: LeftOpen
    weights: np.ndarray
    load: np.ndarray | None = None

    def columns(self, equations: Equations, jointwise: np.ndarray) -> np.ndarray:
        """What one unit of each error does by them, and by the parameters of joints, rows (R, n, U) [N·m].

        Args:
            jointwise: see `Equations`.
        """
        width, joints = equations.width, self.left_open.joints
        terms = (Term(get(name), joint) for name in COMMON for joint in range(width))
        of_joints = np.concatenate([equations.columns(term) for term in terms], axis=2) @ jointwise
        motion, passing = equations.motion, equations.passing
        added = self.left_open.columns(motion.robot, motion.signals, self.load)
        rows = equations.reduced(added if passing is None else added * passing[:, joints], borne=False)
        own = (joints == joint for joint in range(width))
        return np.asarray(of_joints + np.stack([rows[:, one] @ self.weights[one] for one in own], axis=1))

    def moved(self, before: LocalResiduals | None, errors: np.ndarray) -> LocalResiduals | None:
        """What joints add that was learned before, with its weights moved by their errors (U,)."""
        return self.left_open.moved(before, self.weights @ errors)
