"""Reality that differs from the description: links off by some per cent, worn joints."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from bdnn_ros.robot import Robot

FRICTION_SHARE = (0.005, 0.02)
"""Coulomb friction of a worn joint, and its viscous friction at half the velocity limit, each per effort limit."""
ARMATURE_SHARE = (0.001, 0.003)
"""Rotor inertia [kg·m²] of a worn joint per effort limit [N·m], as identified on industrial arms."""


def wrong_robot(robot: Robot, share: float, rng: np.random.Generator) -> Robot:
    """The robot with masses, centres of mass and inertias off by about `share` (standard deviation).

    Each body's mass distribution is stretched along the axes of its frame, shifted, and rescaled, so that
    its inertia stays physically possible. What is zero by symmetry stays zero.
    """
    inertials = robot.inertials.copy()
    for body, parameters in enumerate(robot.inertials):
        if parameters[0] > 0.0 and share > 0.0:
            inertials[body] = _deformed(parameters, share, rng)
    return robot.with_inertials(inertials)


def worn_robot(robot: Robot, effort: np.ndarray, rng: np.random.Generator) -> Robot:
    """The robot with Coulomb and viscous friction and rotor inertia on every joint.

    Args:
        effort: typical effort of each joint, (n,) [N·m], used where the URDF gives no effort limit.
    """
    n = robot.width
    limit = np.where(np.isfinite(robot.limits.effort), robot.limits.effort, 4.0 * effort)
    speed = 0.5 * robot.limits.usual_velocity
    return robot.with_joint_parameters(
        armature=robot.armature + rng.uniform(*ARMATURE_SHARE, n) * limit,
        viscous=robot.viscous + rng.uniform(*FRICTION_SHARE, n) * limit / speed,
        coulomb=robot.coulomb + rng.uniform(*FRICTION_SHARE, n) * limit,
    )


def _deformed(parameters: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Inertial parameters of the deformed body, (PER_LINK,)."""
    inertia = pin.Inertia.FromDynamicParameters(parameters)
    tensor = np.array(inertia.inertia)
    spread = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    weight, *stretch = 1.0 + share * np.clip(rng.standard_normal(4), -2.0, 2.0) * (1.0, 0.5, 0.5, 0.5)
    centre = np.array(inertia.lever) * (1.0 + share * np.clip(rng.standard_normal(3), -2.0, 2.0))
    spread = weight * spread * np.outer(stretch, stretch)
    deformed = pin.Inertia.Zero()  # the constructor refuses slightly negative moments, as some URDFs have
    deformed.mass, deformed.lever = float(weight * inertia.mass), centre
    deformed.inertia = np.trace(spread) * np.eye(3) - spread
    return np.array(deformed.toDynamicParameters())
