"""What recordings are compared with where a model identified earlier takes the simulation's place: its sensors aside.

What that model says of sensors is taken out of the recordings before anything is looked for: a cause then has its real
size, and is no cause where the sensor is as it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from bdnn_ros.errors import listed
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals


class Predicts(Protocol):
    """A model that predicts the effort along a motion."""

    def predict(self, signals: Signals) -> np.ndarray:
        """(N, n) [N·m], not low-passed."""


@runtime_checkable
class KnowsSensors(Predicts, Protocol):
    """A model that says of sensors what they do."""

    def compared(self) -> Compared:
        """Itself as recordings of another time are compared with it."""


@dataclass(frozen=True)
class Compared:
    """A model of efforts in the units in which they act, and what its sensors do beside.

    Attributes:
        model: predicts `scale` times what is measured; None where the simulation is compared with.
        robot: what it believes, at the positions that the joints report.
        scale: effort that acts, but for an offset, per measured effort, (n,).
        velocity_cutoff: of the low-passes on reported velocities, (n,) [Hz], infinite for none.
    """

    model: Predicts | None
    robot: Robot
    scale: np.ndarray
    velocity_cutoff: np.ndarray

    @classmethod
    def of(cls, model: Predicts | None, robot: Robot) -> Compared:
        """A model with its robot; the robot is its own where it says of sensors what they do."""
        if isinstance(model, KnowsSensors):
            return model.compared()
        return cls(model, robot, np.ones(robot.width), np.full(robot.width, np.inf))

    def acting(self, recordings: Sequence[Recording]) -> list[Recording]:
        """Recordings with efforts in the units in which they act, and a note where those are others."""
        other = np.flatnonzero(self.scale != 1.0)
        if not len(other):
            return list(recordings)
        factors = listed((f"{self.scale[k]:.3g} at {self.robot.joints[k]}" for k in other), 20)
        said = f"efforts are looked at as they act by the earlier model, times {factors}."
        return [
            replace(one, effort=one.require_effort() * self.scale, notes=(*one.notes, f"{one.name}: {said}"))
            for one in recordings
        ]
