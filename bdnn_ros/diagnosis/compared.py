"""What recordings are compared with where a model identified earlier takes the simulation's place: its sensors aside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

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
    """A model whose encoders' zeros are its robot's.

    Attributes:
        model: None where the simulation is compared with.
        robot: what it believes, at the positions that the joints report.
    """

    model: Predicts | None
    robot: Robot

    @classmethod
    def of(cls, model: Predicts | None, robot: Robot) -> Compared:
        """A model with its robot; the robot is its own where it says of sensors what they do."""
        if isinstance(model, KnowsSensors):
            return model.compared()
        return cls(model, robot)
