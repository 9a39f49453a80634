"""Tracking control: inverse dynamics of the description at the measured state, and a position loop."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from bdnn_ros.effects.plant import Plant
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import Trajectory

BANDWIDTH = 40.0
"""Bandwidth of the position loops [rad/s]."""
DAMPING = 1.0
PHASE_BUDGET = 0.2
"""Bandwidth times dead time (half a sample, and the effort's delay) must not exceed this [rad]."""
BEHIND = 0.1
"""Known resistance that would hold a joint this far from its plan is compensated [rad]."""
HEAVIER = 2.0
"""Ratio of real to described inertia from which the position loop knows the real one, as if it was tuned."""
SOFTEST = 0.25
"""Largest bandwidth per natural frequency of the link on its elastic gear."""


class Controller:
    """Computed torque: u = known inverse dynamics at (q, qd, qdd_plan + k_p error + k_d error rate).

    It knows the description and the effects it is told of. Of the real robot it knows, as if tuned on it, only the rotor
    inertias, the possible loop bandwidth, and the inertia of joints that move far more than described, such as a wrist with
    its payload. Known friction and other known resistance is left to the position loop, unless it would hold the joint far
    from its plan.

    Args:
        known: the description with the known effects.
        plant: the real robot.
        plan: the motion to follow.
    """

    def __init__(self, known: Plant, plant: Plant, plan: Trajectory) -> None:
        self.plan, nominal = plan, known.robot
        self.model, self.order = nominal.pinocchio_model()
        heavier = plant.robot.armature + _unknown_inertia(nominal, plant.robot, plan)
        self.model.armature[:] = heavier[np.argsort(self.order)]
        self.data = self.model.createData()
        self.back = np.argsort(self.order)
        self.limit = nominal.limits.effort
        bandwidth = loop_bandwidth(nominal, plant, plan)
        self.stiffness, self.damping = bandwidth**2, 2.0 * DAMPING * bandwidth
        self.scale = known.scale
        self.beside = self._beside(known, plant.robot, plan)

    def effort(self, sample: int, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Commanded effort at a sample, within the limits, (n,) [N·m]."""
        plan, back = self.plan, self.back
        wanted = plan.acceleration[sample] + self.stiffness * (plan.position[sample] - position)
        wanted += self.damping * (plan.velocity[sample] - velocity)
        command = pin.rnea(self.model, self.data, position[back], velocity[back], wanted[back])[self.order]
        command = (command + self.beside[sample]) / self.scale
        return np.minimum(np.maximum(command, -self.limit), self.limit)

    def _beside(self, known: Plant, real: Robot, plan: Trajectory) -> np.ndarray:
        """Known resistance beyond rigid bodies along the plan, for joints that would lag far behind without it, (N, n) [N·m]."""
        resisting = known.robot.friction(plan.position, plan.velocity) - known.offset
        resisting += known.resistance(plan.time, plan.position, plan.velocity, plan.acceleration)
        try:
            mobility = np.linalg.inv(known.robot.mass_matrix(plan.position[::50]))
        except np.linalg.LinAlgError:  # a link is described without mass
            mobility = np.linalg.inv(real.mass_matrix(plan.position[::50]))
        inertia = 1.0 / np.diagonal(mobility, axis1=1, axis2=2).max(axis=0)
        behind = np.abs(resisting).max(axis=0) > BEHIND * self.stiffness * inertia
        return np.where(behind, resisting, 0.0)


def loop_bandwidth(nominal: Robot, plant: Plant, plan: Trajectory) -> float:
    """Bandwidth that the worst joint's dead time and elasticity allow [rad/s]; the arm couples all loops."""
    period = float(plan.time[1] - plan.time[0])
    timely = PHASE_BUDGET / (0.5 * period + plant.delay)
    described, real = (
        np.diagonal(robot.mass_matrix(plan.position[::50]), axis1=1, axis2=2).max(axis=0)
        for robot in (nominal, plant.robot)
    )
    inertia = np.where(described > 0.0, described, real)
    return float(min(BANDWIDTH, timely.min(), (SOFTEST * np.sqrt(plant.stiffness / inertia)).min()))


def _unknown_inertia(nominal: Robot, real: Robot, plan: Trajectory) -> np.ndarray:
    """Inertia beyond the described one, of joints that move `HEAVIER` times as much, its minimum along the plan, (n,) [kg·m²]."""
    poses = plan.position[::50]
    described, moved = (
        np.diagonal(robot.mass_matrix(poses) - np.diag(robot.armature), axis1=1, axis2=2)
        for robot in (nominal, real)
    )
    beside = (moved - described).min(axis=0)
    return np.where(beside > (HEAVIER - 1.0) * described.mean(axis=0), beside, 0.0)
