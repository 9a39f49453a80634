"""What is not known of what an identified model's joints may add to the effort of its rigid bodies: learned, or left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bdnn_ros.effects.motion import Motion
from bdnn_ros.physical.left_open import LeftOpen
from bdnn_ros.physical.local import LocalResiduals


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

    def columns(
        self, motion: Motion, passing: np.ndarray | None, reduced: Callable[[np.ndarray], np.ndarray]
    ) -> np.ndarray:
        """What one unit of each error does by them, rows (R, n, U) [N·m].

        Args:
            passing: how much more effort it takes of each joint, (N, n), where that is not one.
            reduced: makes rows of values at the working rate.
        """
        joints = self.left_open.joints
        added = self.left_open.columns(motion.robot, motion.signals, self.load)
        rows = reduced(added if passing is None else added * passing[:, joints])
        of_joints = (joints == joint for joint in range(motion.robot.width))
        return np.stack([rows[:, own] @ self.weights[own] for own in of_joints], axis=1)

    def moved(self, before: LocalResiduals | None, errors: np.ndarray) -> LocalResiduals | None:
        """What joints add that was learned before, with its weights moved by their errors (U,)."""
        return self.left_open.moved(before, self.weights @ errors)
