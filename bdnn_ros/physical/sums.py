"""Statistics of all motion, accumulated, and recomputed once more is known of the robot."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from bdnn_ros.physical.columns import low_passed, sharp_columns, smooth_columns, tilting
from bdnn_ros.physical.dictionary import Scales
from bdnn_ros.physical.parameters import Parameters, Prior
from bdnn_ros.physical.presliding import Directions, directions
from bdnn_ros.physical.recursive import Recursion
from bdnn_ros.physical.sensing import SensorNoise
from bdnn_ros.physical.weighing import certainty, holding, moving, sliding
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals

FAST = 0.02
"""Speed, in units of the limit, above which friction is sliding friction."""


@dataclass(frozen=True)
class Motion:
    """A chunk of motion: its signals, its rows, and the state of friction at its start."""

    signals: Signals
    rows: np.ndarray
    start: Directions | None


class Sums:
    """Statistics for the parameters and for the selection of terms.

    Args:
        robot: the simulation's.
        belief: of the base parameters before any motion.

    Attributes:
        recursion: of the parameters: rows count by how surely the joints slide.
        evidence: of the choice of terms: all rows of moving joints alike, but those where friction may be anything hardly.
        fast: Σ φ φᵀ of each joint's columns after the bodies', over fast motion, (n, K', K').
        usual: standard deviation that the residual is taken to have, (n,) [N·m].
    """

    def __init__(self, robot: Robot, belief: Prior, scales: Scales) -> None:
        self.scales = scales
        self.recursion, self.evidence = Recursion(belief), Recursion(belief)
        self.fast = np.zeros(())
        self.usual = self.evidence.noise
        self._described = Parameters.from_vector(np.sqrt(np.diagonal(belief.covariance))).coulomb
        self.take_for(robot)

    def take_for(self, carrier: Robot, unknown: np.ndarray | None = None) -> None:
        """Linearise bodies, dry friction and tilt about this robot from now on.

        Args:
            unknown: standard deviation of its dry friction, (n,) [N·m]; None before any motion.
        """
        self._carrier, self._tilts = carrier, tilting(carrier)
        self._unknown = self._described if unknown is None else unknown

    def again(self, motions: Iterable[Motion], usual: np.ndarray) -> None:
        """Recompute from all motion, given the standard deviation of the residual, (n,) [N·m]."""
        self.usual = usual
        self.recursion.clear()
        self.evidence.clear()
        self.fast = np.zeros(())
        for motion in motions:
            self.add(motion)

    def add(self, motion: Motion) -> Directions:
        """Add a chunk; returns the directions of friction along it."""
        signals, rows, carrier = motion.signals, motion.rows, self._carrier
        assert signals.effort is not None
        state = directions(signals, motion.start)
        smooth = smooth_columns(carrier, signals, self._tilts)
        bodies = carrier.inertials.size
        load = smooth[:, :, :bodies] @ carrier.inertials.ravel()
        sharp = sharp_columns(signals, state, load, self.scales)
        columns = low_passed(signals, smooth, sharp, rows)
        fast = np.abs(signals.velocity[rows]) > FAST * self.scales.velocity
        swift = (columns[:, :, bodies:] * fast[:, :, None]).swapaxes(0, 1)
        self.fast = self.fast + swift.transpose(0, 2, 1) @ swift
        effort = signals.smooth(signals.effort)[rows]
        noise = SensorNoise.of(carrier, signals, rows)
        residual = np.maximum(np.sqrt(noise.effort / noise.count), self.usual)
        certain = certainty(signals, rows, state, carrier.coulomb, residual)
        certain *= holding(signals, rows, state, self._unknown, residual)
        # an error of doubtful rows is as large as others so weighed, but the same at each stop: that squared says nothing
        self.evidence.update(columns, effort, certain**2 * moving(signals, rows), noise)
        self.recursion.update(columns, effort, certain * sliding(signals, rows, self.scales), noise)
        return state
