"""Checks that a model read from a file is physically possible: no negative mass, friction or variance."""

from __future__ import annotations

import numpy as np

from bdnn_ros.errors import RobotError
from bdnn_ros.robot import Robot
from bdnn_ros.robot.bodies import pseudo_inertia
from bdnn_ros.robot.units import along, printed

ROUNDING = 1e-6
"""Correlations, and eigenvalues of a pseudo-inertia relative to its largest, are good to this."""
TAKEN_OFF = 0.1
"""What a diagnosis takes off a joint may exceed what it had by its uncertainty: by this share of the most that a joint has."""
PER_JOINT = {
    "armature": ("armature", "kg*m^2"),
    "viscous": ("viscous friction", "N*m*s/rad"),
    "coulomb": ("Coulomb friction", "N*m"),
}
"""What a joint's parameters are called, and their units where it turns."""


def require_plausible(robot: Robot, bodies: np.ndarray | None = None, slack: float = 0.0) -> None:
    """Refuse a robot that cannot exist, unless its own description is impossible in the same way (as some are).

    Args:
        bodies: what stands for the robot's own inertial parameters, (n, PER_LINK): those with all that hangs from them.
        slack: share of the largest that each kind of a joint's parameters may be below zero.

    Raises:
        RobotError: a body has a mass or a pseudo-inertia below zero, or a joint armature or friction.
    """
    bodies = robot.inertials if bodies is None else bodies
    lowest, highest = _spread(bodies)
    if min(lowest.min(), *(getattr(robot, what).min() for what in PER_JOINT)) >= 0.0:
        return
    described = Robot.from_urdf(robot.urdf, robot.joints, dict(robot.held))
    for what, (friction, unit) in PER_JOINT.items():
        values = getattr(robot, what)
        allowed = np.minimum(getattr(described, what), 0.0) - slack * values.max(initial=0.0)
        for joint in np.flatnonzero(values < allowed):
            its = printed(along(unit, bool(robot.slides[joint])))
            raise RobotError(
                f"{robot.joints[joint]} has {friction} of {values[joint]:.3g} {its}, which cannot be."
            )
    allowed = np.minimum(_spread(described.inertials)[0], 0.0) - ROUNDING * np.maximum(highest, 0.0)
    for body in np.flatnonzero((bodies[:, 0] < 0.0) | (lowest < allowed)):
        mass = bodies[body, 0]
        much = f"weighs {mass:.3g} kg" if mass < 0.0 else "has some of its mass below zero"
        raise RobotError(f"The body that {robot.joints[body]} moves {much}, which cannot be.")


def require_covariance(covariance: np.ndarray) -> None:
    """Refuse a matrix (P, P) that is not a covariance.

    Raises:
        RobotError: it is not symmetric, or not positive semi-definite, by more than rounding.
    """
    variance = np.diagonal(covariance)
    size = np.sqrt(np.where(variance > 0.0, variance, 1.0))
    relative = covariance / np.outer(size, size)
    symmetric = np.abs(relative - relative.T).max(initial=0.0) <= ROUNDING
    if not symmetric or np.linalg.eigvalsh(relative).min(initial=0.0) < -ROUNDING:
        raise RobotError("Its covariance is none.")


def _spread(bodies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest eigenvalue of the pseudo-inertias of bodies (n, PER_LINK), (n,) each."""
    values = np.linalg.eigvalsh(pseudo_inertia(bodies))
    return values[:, 0], values[:, -1]
