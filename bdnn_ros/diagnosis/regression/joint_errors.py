"""Errors of an identified model at its joints: of their parameters, and of residuals that were learned or left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdnn_ros.diagnosis.regression.columns import Columns
from bdnn_ros.diagnosis.regression.term import COMMON, Term
from bdnn_ros.effects.registry import get
from bdnn_ros.physical.left_open import LeftOpen
from bdnn_ros.physical.local import LocalResiduals
from bdnn_ros.physical.sums import FAST

STRAIGHT = COMMON[1:]
"""Straight part of joint residuals: viscous and Coulomb friction and offset, signed as in the contract."""
CONTRACT_SIGNS = np.array([1.0, 1.0, -1.0])
"""Signs from `LocalResiduals.straight` to the contract: its offsets add to the measured effort, the contract's to what acts."""
SINGULAR_SHARE = 1e-2
"""Relative singular value below which the motion does not show a direction of these: Coulomb versus viscous at one speed."""


@dataclass(frozen=True)
class JointErrors:
    """U independent errors of an identified model at its joints, the same as of its links.

    Attributes:
        left_open: the basis of the residuals' weights.
        parameters: map from the errors to `COMMON` at every joint, kind by kind, (len(COMMON) * n, U).
        weights: map from the errors to the weights of the joints' residuals, (W, U) [N·m].
        load: effort that bodies take, (N, n) [N·m], if that may differ from the model's; else None.
    """

    left_open: LeftOpen
    parameters: np.ndarray
    weights: np.ndarray
    load: np.ndarray | None = None

    def columns(self, columns: Columns) -> np.ndarray:
        """Effort per unit of each error, through the weights and the parameters of joints, rows (R, n, U) [N·m]."""
        width, joints = columns.motion.signals.width, self.left_open.joints
        terms = (Term(get(name), joint) for name in COMMON for joint in range(width))
        of_joints = np.concatenate([columns.of(term) for term in terms], axis=2) @ self.parameters
        rows, own = self._rows(columns), (joints == joint for joint in range(width))
        return np.asarray(of_joints + np.stack([rows[:, one] @ self.weights[one] for one in own], axis=1))

    def _rows(self, columns: Columns) -> np.ndarray:
        """Effort per unit of each weight at its joint, rows (R, W) [N·m]."""
        motion, passing = columns.motion, columns.decimation.load_friction_factor
        added = self.left_open.columns(motion.robot, motion.signals, self.load)
        if passing is not None:
            added = added * passing[:, self.left_open.joints]
        return columns.decimation.as_rows(added, borne=False)

    def straight(self, columns: Columns, usable: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Best straight description of each weight along a motion, (W, 3), and projections onto what it shows, (n, 3, 3).

        As in identification, only fast rows count, since dry friction is undetermined where a joint reverses.

        Args:
            usable: rows that count, (R, n) bool.
        """
        rows, joints, width = self._rows(columns), self.left_open.joints, columns.motion.signals.width
        speed = np.abs(columns.motion.velocity)[columns.decimation.samples]
        counted = usable & (speed > FAST * self.left_open.scale_velocity)
        weights, shown = (
            np.zeros((len(joints), len(STRAIGHT))),
            np.zeros((width, len(STRAIGHT), len(STRAIGHT))),
        )
        for joint in range(width):
            own, when = joints == joint, counted[:, joint]
            terms = [Term(get(name), joint) for name in STRAIGHT]
            plain = np.concatenate([columns.of(term)[when, joint] for term in terms], axis=1)
            size = np.maximum(np.linalg.norm(plain, axis=0), 1e-12)
            back = np.linalg.pinv(plain / size, rcond=SINGULAR_SHARE) / size[:, None]
            weights[own], shown[joint] = (back @ rows[when][:, own]).T, back @ plain
        return weights, shown

    def handed_back(self, columns: Columns, usable: np.ndarray, learned: LocalResiduals) -> np.ndarray:
        """`STRAIGHT` part of learned residuals beyond what was taken out before, as far as the motion shows it, (3, n).

        Args:
            usable: rows that count, (R, n) bool.
        """
        straight, shown = self.straight(columns, usable)
        result = np.zeros((len(STRAIGHT), len(shown)))
        places = self.left_open.joints, self.left_open.places
        np.add.at(result.T, places[0], straight * learned.weights[places][:, None])
        return result - np.einsum("jkl,jl->kj", shown, learned.straight * CONTRACT_SIGNS)

    def moved(self, before: LocalResiduals | None, errors: np.ndarray) -> LocalResiduals | None:
        """Learned residuals with their weights moved by errors (U,)."""
        return self.left_open.moved(before, self.weights @ errors)
