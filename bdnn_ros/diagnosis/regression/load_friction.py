"""Load-dependent friction of an earlier model: how it amplifies efforts that are added to that model's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdnn_ros.physical.local import LocalResiduals
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals


@dataclass(frozen=True)
class LoadFriction:
    """Load-dependent friction of an earlier model.

    Attributes:
        ratios: friction per effort that acts at each joint, (n,).
        learned: learned joint residuals, part of which may grow with the bodies' load; None for none.
    """

    ratios: np.ndarray | float = 0.0
    learned: LocalResiduals | None = None

    def applied(
        self, signals: Signals, robot: Robot, simulated: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """The simulation's effort with this friction, and its factor on effort that is added, (N, n) each; None for 1.

        The sign of the load is taken from the measured effort, since a simulation that is off may have it the other way.
        """
        passing = None
        if self.learned is not None and self.learned.by_load:
            simulated, passing = self._learned(signals, robot, self.learned, simulated)
        if np.any(self.ratios):
            own = self._passing(signals, _measured(signals))
            simulated = simulated * own / self._passing(signals, simulated)
            passing = own if passing is None else own * passing
        return simulated, passing

    def _passing(self, signals: Signals, load: np.ndarray) -> np.ndarray:
        """Effort per effort without the friction of `ratios`, under a load (N, n) [N·m], (N, n)."""
        return signals.soften(1.0 / (1.0 - self.ratios * signals.direction * np.sign(load)))

    @staticmethod
    def _learned(
        signals: Signals, robot: Robot, learned: LocalResiduals, simulated: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """As `applied`, for the learned part alone, which grows with the load of the bodies without friction."""
        load = robot.rigid_effort(signals.position, signals.velocity, signals.acceleration)
        growth = learned.growth(signals.velocity, signals.direction)
        way = np.sign(_measured(signals) - (simulated - load))
        further = signals.soften(growth * (way * load - np.abs(load)))
        return simulated + further, 1.0 + signals.soften(growth * way)


def body_effort(signals: Signals, robot: Robot, simulated: np.ndarray, passing: np.ndarray) -> np.ndarray:
    """Effort that bodies take, any additions to the robot's included, by the measured effort, (N, n) [N·m].

    Args:
        simulated, passing: see `LoadFriction.applied`.
    """
    load = robot.rigid_effort(signals.position, signals.velocity, signals.acceleration)
    return np.asarray(load + (_measured(signals) - simulated) / passing)


def _measured(signals: Signals) -> np.ndarray:
    """Low-passed measured effort, (N, n) [N·m]."""
    assert signals.effort is not None
    return signals.smooth(signals.effort)
