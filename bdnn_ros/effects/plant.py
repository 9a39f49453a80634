"""What an effect can change about a simulated robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from bdnn_ros.robot import Robot

JointEffort = Callable[[float, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""(time [s], position (n,), velocity (n,), load (n,) [N·m]) -> smooth resisting effort (n,) [N·m]."""
DryFriction = Callable[[float, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""As `JointEffort`, but the magnitude (n,) of dry friction; the integrator gives it the direction that resists."""


@dataclass
class Plant:
    """A robot with its joints, drives and sensors, as the simulation integrates it.

    Attributes:
        robot: rigid bodies, armature, and the friction of the URDF's tags.
        efforts: smooth resisting efforts (springs, drag, cogging, bristles ...).
        dry: magnitudes of dry friction.
        scale, offset, delay: effort that acts = scale · commanded(t - delay) + offset; (n,) each, delay in [s].
        stiffness: joint elasticity between the motor, whose position is measured, and the link (n,) [N·m/rad].
        gap: backlash between motor and link, full width (n,) [rad].
        position_offset: measured position = true position + offset, (n,) [rad].
        velocity_cutoff: low-pass of the reported velocity, (n,) [Hz].
    """

    robot: Robot
    efforts: list[JointEffort] = field(default_factory=list)
    dry: list[DryFriction] = field(default_factory=list)
    scale: np.ndarray = field(init=False)
    offset: np.ndarray = field(init=False)
    delay: np.ndarray = field(init=False)
    stiffness: np.ndarray = field(init=False)
    gap: np.ndarray = field(init=False)
    position_offset: np.ndarray = field(init=False)
    velocity_cutoff: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        n = self.robot.width
        self.scale = np.ones(n)
        self.offset = np.zeros(n)
        self.delay = np.zeros(n)
        self.stiffness = np.full(n, np.inf)
        self.gap = np.zeros(n)
        self.position_offset = np.zeros(n)
        self.velocity_cutoff = np.full(n, np.inf)
