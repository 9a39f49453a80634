"""Reality beside the description: links that differ by some per cent, joints that are worn."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from bdnn_ros.robot import Robot

FRICTION_SHARE = (0.005, 0.02)
"""Coulomb friction, and viscous friction at half the velocity limit, of a worn joint per effort limit."""
ARMATURE_SHARE = (0.001, 0.003)
"""Rotor inertia [kg·m²] of a worn joint per effort limit [N·m]: what identified industrial arms show."""


def wrong_robot(robot: Robot, share: float, rng: np.random.Generator) -> Robot:
    """The robot with masses, centres of mass and inertias off by about `share` (standard deviation), consistently.

    Each body's mass distribution is deformed by a linear map, moved by a share of its radius of gyration, and weighed
    anew, so that its inertia stays one that a body can have.
    """
    inertials = robot.inertials.copy()
    for body, parameters in enumerate(robot.inertials):
        if parameters[0] > 0.0 and share > 0.0:
            inertials[body] = _deformed(parameters, share, rng)
    return robot.with_inertials(inertials)


def worn_robot(robot: Robot, effort: np.ndarray, rng: np.random.Generator) -> Robot:
    """The robot with Coulomb and viscous friction and rotor inertia on every joint.

    Args:
        effort: typical effort of each joint, (n,) [N·m]; stands in for an effort limit that the URDF does not give.
    """
    n = robot.width
    limit = np.where(np.isfinite(robot.limits.effort), robot.limits.effort, 4.0 * effort)
    speed = 0.5 * np.where(np.isfinite(robot.limits.velocity), robot.limits.velocity, 2.0)
    return robot.with_joint_parameters(
        armature=robot.armature + rng.uniform(*ARMATURE_SHARE, n) * limit,
        viscous=robot.viscous + rng.uniform(*FRICTION_SHARE, n) * limit / speed,
        coulomb=robot.coulomb + rng.uniform(*FRICTION_SHARE, n) * limit,
    )


def _deformed(parameters: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Inertial parameters of the deformed body, (PER_LINK,)."""
    inertia = pin.Inertia.FromDynamicParameters(parameters)
    mass, centre = inertia.mass, np.array(inertia.lever)
    tensor = np.array(inertia.inertia)
    spread = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    gyration = np.sqrt(max(np.trace(spread) / mass, 0.0))

    def drawn(*shape: int) -> np.ndarray:
        return np.clip(rng.standard_normal(shape), -2.0, 2.0)

    weight = 1.0 + share * float(drawn(1)[0])
    stretch = np.eye(3) + 0.5 * share * drawn(3, 3)
    size = np.hypot(gyration, np.linalg.norm(centre))
    centre = centre + share * size * drawn(3) / np.sqrt(3.0)
    spread = weight * stretch @ spread @ stretch.T
    deformed = pin.Inertia(weight * mass, centre, np.trace(spread) * np.eye(3) - spread)
    return np.array(deformed.toDynamicParameters())
