"""A model that knows the truth, and its motion, and an arm that slides, for tests of the command and the report."""

from __future__ import annotations

import numpy as np
from bag_cases import EPOCH, PENDULUM

from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals


class Pendulum(Robot):
    """A model that knows the truth."""

    kind = "pendulum"

    def predict(self, signals: Signals) -> np.ndarray:
        """Effort along a motion, (N, 1) [N·m]."""
        return self.inverse_dynamics(signals.position, signals.velocity, signals.acceleration)


def swing(model: Robot, duration: float = 8.0, rate: float = 200.0) -> Recording:
    """The pendulum along a sinusoid."""
    time = np.round(np.arange(0.0, duration, 1.0 / rate), 9)
    q, v = 0.8 * np.sin(2.0 * time)[:, None], 1.6 * np.cos(2.0 * time)[:, None]
    effort = model.inverse_dynamics(q, v, -4.0 * q)
    return Recording(time, model.joints, q, v, effort, name="swing", urdf=PENDULUM, epoch=EPOCH)


def sliding_arm() -> Robot:
    """An arm whose second joint slides."""
    plain = Robot.bundled("arm2").urdf
    name = plain.index('name="arm2_joint2"')
    return Robot.from_urdf(plain[:name] + plain[name:].replace('"revolute"', '"prismatic"', 1))
