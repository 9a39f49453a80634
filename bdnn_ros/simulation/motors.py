"""Motors behind an elastic or loose gear: each has its own inertia and bears the drive's friction."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bdnn_ros.effects.plant import DryFriction, JointEffort, Plant

LEAST_ROTOR = 0.002
"""Rotor inertia of a joint without armature, as a share of the link's inertia."""
CONTACT_SHARE = 0.05
"""Deflection of a loose but stiff gear under the joint's largest load, as a share of its gap."""
QUICK = 50.0
"""Acceleration that sets a joint's largest load if gravity does not [rad/s²]."""
DAMPING_RATIO = 1.0
"""Damping ratio of the rotor's oscillation on the gear."""
STEPS_PER_RADIAN = 2.5
"""Steps of integration per radian of the fastest oscillation of a link on its gear."""


@dataclass
class Motor:
    """One motor; `position` is what its encoder sees and reports with an `offset`."""

    inertia: float
    stiffness: float
    damping: float
    gap: float
    viscous: float
    coulomb: float
    position: float
    velocity: float = 0.0
    offset: float = 0.0
    efforts: list[JointEffort] = field(default_factory=list)
    dry: list[DryFriction] = field(default_factory=list)

    def advance(self, time: float, h: float, load: float, link: float, link_velocity: float) -> float:
        """One implicit step under the drive's effort; returns the effort that the gear passes on to the link [N·m]."""
        middle = self.position + 0.5 * h * self.velocity
        twist = middle - link
        bend = twist - min(max(twist, -0.5 * self.gap), 0.5 * self.gap)
        stiffness, damping = (self.stiffness, self.damping) if bend or not self.gap else (0.0, 0.0)
        drive = load
        for resist in self.efforts:
            drive -= resist(time, middle + self.offset, self.velocity, load)
        coupling = h * damping + 0.5 * h * h * stiffness
        weight = self.inertia + h * self.viscous + coupling
        impulse = self.inertia * self.velocity + h * (drive - stiffness * bend) + coupling * link_velocity
        velocity = self._slowed(time, load, impulse, h, weight)
        self.position = middle + 0.5 * h * velocity
        self.velocity = velocity
        return stiffness * bend + coupling / h * (velocity - link_velocity)

    def _slowed(self, time: float, load: float, impulse: float, h: float, weight: float) -> float:
        """Velocity after dry friction has taken its share of the impulse."""
        direction = 1.0 if impulse > 0.0 else -1.0
        speed = abs(self.velocity) if self.velocity * impulse > 0.0 else 0.0
        friction = self.coulomb + sum(resist(time, speed, load, direction) for resist in self.dry)
        left = abs(impulse) - h * friction
        return direction * left / weight if left > 0.0 else 0.0


@dataclass
class Motors:
    """The motors of those `joints` of a plant that are not rigidly coupled to their links."""

    joints: list[int]
    motors: list[Motor]
    link_inertia: list[float]

    @classmethod
    def of(cls, plant: Plant, position: np.ndarray, load: np.ndarray) -> Motors:
        """The motors of a plant that rests at `position` (n,) under `load` (n,)."""
        robot = plant.robot
        joints = [j for j in range(robot.width) if np.isfinite(plant.stiffness[j]) or plant.gap[j] > 0.0]
        inertia = np.diag(robot.mass_matrix(position)) - robot.armature
        motors = [_motor(plant, j, float(inertia[j]), float(position[j]), float(load[j])) for j in joints]
        return cls(joints, motors, [float(inertia[j]) for j in joints])

    def longest_step(self) -> float:
        """Longest step that resolves the links' oscillation on their gears [s]."""
        rates = [np.sqrt(m.stiffness / i) for m, i in zip(self.motors, self.link_inertia, strict=True)]
        return float(1.0 / (STEPS_PER_RADIAN * max(rates))) if rates else np.inf

    def advance(
        self,
        time: float,
        h: float,
        load: np.ndarray,
        position: np.ndarray,
        velocity: np.ndarray,
        drive: np.ndarray,
    ) -> None:
        """Steps every motor; in `drive` (n,), the load is replaced by what reaches the link."""
        for joint, motor in zip(self.joints, self.motors, strict=True):
            passed = motor.advance(
                time, h, float(load[joint]), float(position[joint]), float(velocity[joint])
            )
            drive[joint] += passed - load[joint]

    def seen(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Replaces the links' position and velocity by what the encoders see, (n,) each."""
        for joint, motor in zip(self.joints, self.motors, strict=True):
            position[joint], velocity[joint] = motor.position, motor.velocity


def _motor(plant: Plant, joint: int, link_inertia: float, position: float, load: float) -> Motor:
    robot = plant.robot
    inertia = max(float(robot.armature[joint]), LEAST_ROTOR * link_inertia)
    gap, stiffness = float(plant.gap[joint]), float(plant.stiffness[joint])
    if not np.isfinite(stiffness):
        stiffness = max(abs(load), QUICK * link_inertia) / (CONTACT_SHARE * gap)
    side = np.sign(load) if load else 1.0
    return Motor(
        inertia=inertia,
        stiffness=stiffness,
        damping=2.0 * DAMPING_RATIO * np.sqrt(stiffness * inertia),
        gap=gap,
        viscous=float(robot.viscous[joint]),
        coulomb=float(robot.coulomb[joint]),
        position=position + load / stiffness + 0.5 * gap * side,
        offset=float(plant.position_offset[joint]),
        efforts=[resist for j, resist in plant.efforts if j == joint],
        dry=[resist for j, resist in plant.dry if j == joint],
    )
