"""Uncertainty of the residuals that an identified model's joints add to its rigid bodies, learned or left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bdnn_ros.diagnosis.regression.term import COMMON, Term
from bdnn_ros.effects.registry import get
from bdnn_ros.physical.left_open import LeftOpen
from bdnn_ros.physical.local import LocalResiduals
from bdnn_ros.physical.sums import FAST

if TYPE_CHECKING:
    from bdnn_ros.diagnosis.regression.equations import Equations

STRAIGHT = COMMON[1:]
"""Straight part of joint residuals: viscous and Coulomb friction and offset, signed as in the contract."""
CONTRACT_SIGNS = np.array([1.0, 1.0, -1.0])
"""Signs from `LocalResiduals.straight` to the contract: its offsets add to the measured effort, the contract's to what acts."""
SINGULAR_SHARE = 1e-2
"""Relative singular value below which the motion does not show a direction of these: Coulomb versus viscous at one speed."""


@dataclass(frozen=True)
class Learned:
    """Errors of the weights of joint residuals.

    Attributes:
        left_open: the weights' basis.
        weights: map from U independent errors, shared with links and joints, to the weights', (W, U) [N·m].
        load: effort that bodies take, (N, n) [N·m], if that may differ from the model's; else None.
    """

    left_open: LeftOpen
    weights: np.ndarray
    load: np.ndarray | None = None

    def columns(self, equations: Equations, jointwise: np.ndarray) -> np.ndarray:
        """Effort per unit of each error, through the weights and the parameters of joints, rows (R, n, U) [N·m].

        Args:
            jointwise: see `Equations`.
        """
        width, joints = equations.width, self.left_open.joints
        terms = (Term(get(name), joint) for name in COMMON for joint in range(width))
        of_joints = np.concatenate([equations.columns(term) for term in terms], axis=2) @ jointwise
        rows, own = self._rows(equations), (joints == joint for joint in range(width))
        return np.asarray(of_joints + np.stack([rows[:, one] @ self.weights[one] for one in own], axis=1))

    def _rows(self, equations: Equations) -> np.ndarray:
        """Effort per unit of each weight at its joint, rows (R, W) [N·m]."""
        motion, passing = equations.motion, equations.load_friction_factor
        added = self.left_open.columns(motion.robot, motion.signals, self.load)
        if passing is not None:
            added = added * passing[:, self.left_open.joints]
        return equations.as_rows(added, borne=False)

    def straight(self, equations: Equations) -> tuple[np.ndarray, np.ndarray]:
        """Best straight description of each weight along a motion, (W, 3), and projections onto what it shows, (n, 3, 3).

        As in identification, only fast rows count, since dry friction is undetermined where a joint reverses.
        """
        rows, joints, width = self._rows(equations), self.left_open.joints, equations.width
        speed = np.abs(equations.motion.velocity)[equations.rows]
        counted = equations.usable & (speed > FAST * self.left_open.scale_velocity)
        weights, shown = (
            np.zeros((len(joints), len(STRAIGHT))),
            np.zeros((width, len(STRAIGHT), len(STRAIGHT))),
        )
        for joint in range(width):
            own, when = joints == joint, counted[:, joint]
            terms = [Term(get(name), joint) for name in STRAIGHT]
            plain = np.concatenate([equations.columns(term)[when, joint] for term in terms], axis=1)
            size = np.maximum(np.linalg.norm(plain, axis=0), 1e-12)
            back = np.linalg.pinv(plain / size, rcond=SINGULAR_SHARE) / size[:, None]
            weights[own], shown[joint] = (back @ rows[when][:, own]).T, back @ plain
        return weights, shown

    def handed_back(self, equations: Equations, learned: LocalResiduals) -> np.ndarray:
        """`STRAIGHT` part of learned residuals beyond what was taken out before, as far as the motion shows it, (3, n)."""
        result, (straight, shown) = np.zeros((len(STRAIGHT), equations.width)), self.straight(equations)
        places = self.left_open.joints, self.left_open.places
        np.add.at(result.T, places[0], straight * learned.weights[places][:, None])
        return result - np.einsum("jkl,jl->kj", shown, learned.straight * CONTRACT_SIGNS)

    def moved(self, before: LocalResiduals | None, errors: np.ndarray) -> LocalResiduals | None:
        """Learned residuals with their weights moved by errors (U,)."""
        return self.left_open.moved(before, self.weights @ errors)
