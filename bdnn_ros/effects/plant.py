"""What an effect can change about a simulated robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from bdnn_ros.robot import Robot

JointEffort = Callable[[float, float, float, float], float]
"""(time [s], position [rad], velocity [rad/s], load [N·m]) -> resisting effort of that joint [N·m], called in
order of time, once a step. The position is the reported one, the load the effort that acts on the joint."""
DryFriction = Callable[[float, float, float, float], float]
"""(time [s], speed [rad/s] >= 0, load [N·m], direction +1 or -1) -> magnitude of dry friction against motion
in that direction [N·m]; at speed 0 the largest that holds the joint."""
Wrench = Callable[[float], np.ndarray]
"""Time [s] -> force and torque on a point of a link, in the base frame's axes, (6,) [N, N·m]."""


@dataclass
class Plant:
    """A robot with its joints, drives and sensors, as the simulation integrates it.

    Attributes:
        robot: rigid bodies, armature, and the friction of the URDF's tags.
        duration: how long the recording will be [s].
        efforts: (joint, smooth resisting effort) in its drive: drag, cogging, bristles ...
        across: (joint, smooth resisting effort) that acts on its link, behind the gear: springs, pushes.
        dry: (joint, magnitude of dry friction); magnitudes on one joint add up.
        wrenches: (link, point in its frame (3,) [m], wrench of the environment on it).
        scale, offset, delay: effort that acts = scale · commanded(t - delay) + offset; (n,) each.
        stiffness: of the gear between motor, whose position is measured, and link (n,) [N·m/rad].
        gap: backlash between motor and link, full width (n,) [rad].
        position_offset: measured position = true position + offset, (n,) [rad].
        velocity_cutoff: first-order low-pass of the reported velocity, (n,) [Hz].
    """

    robot: Robot
    duration: float = 0.0
    efforts: list[tuple[int, JointEffort]] = field(default_factory=list)
    across: list[tuple[int, JointEffort]] = field(default_factory=list)
    dry: list[tuple[int, DryFriction]] = field(default_factory=list)
    wrenches: list[tuple[str, np.ndarray, Wrench]] = field(default_factory=list)
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

    def resistance(
        self, time: np.ndarray, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """Effort with which the effects resist a motion, without bodies, armature and the robot's own friction, (N, n) [N·m].

        Wrenches and `offset` are not included. Some effects have memory, so a plant must be asked only once.
        """
        result = np.zeros(position.shape)
        if not (self.efforts or self.across or self.dry):
            return result
        load, direction = self.robot.inverse_dynamics(position, velocity, acceleration), np.sign(velocity)
        for joint, resist in (*self.efforts, *self.across):
            rows = np.column_stack([time, position[:, joint], velocity[:, joint], load[:, joint]])
            result[:, joint] += [resist(*row) for row in rows.tolist()]
        for joint, resist in self.dry:
            rows = np.column_stack([time, abs(velocity[:, joint]), load[:, joint], direction[:, joint]])
            result[:, joint] += direction[:, joint] * [resist(*row) for row in rows.tolist()]
        return result
