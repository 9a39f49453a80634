"""Where the joints' axes lie, and how far points of a link are from them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from bdnn_ros.robot.robot import Robot

UPRIGHT = 0.01
"""Largest sine of the angle between gravity and an axis that counts as vertical."""


def distances_from_axes(robot: Robot, link: str, point: np.ndarray) -> np.ndarray:
    """Distance of a point from each joint's axis with all joints at zero, (n,) [m]; infinite for prismatic joints.

    Args:
        point: in the link's frame, (3,) [m].

    Raises:
        UsageError: there is no such link, or it is fixed to the base.
    """
    body, rotation, translation = robot.body_of(link)
    model, order = robot.pinocchio_model()
    data = model.createData()
    jacobian = pin.computeJointJacobians(model, data, pin.neutral(model))
    at = data.oMi[int(order[body]) + 1].act(rotation @ point + translation)
    speed = np.linalg.norm(jacobian[:3] + np.cross(jacobian[3:], at, axis=0), axis=0)
    return np.where(robot.slides, np.inf, speed[order])


def rotor_on(robot: Robot, joint: int) -> np.ndarray:
    """Inertial parameters (PER_LINK,) by which a rotor on a joint's axis is a part of the body that it moves, per kg·m²."""
    jacobian, rotation = robot.link_motion(np.zeros((1, robot.width)), robot.moving_link(robot.joints[joint]))
    axis = rotation[0].T @ jacobian[0, 3:, joint]
    return np.concatenate([np.zeros(4), np.outer(axis, axis)[np.tril_indices(3)]])


def turns_all(robot: Robot, joint: int) -> bool:
    """Whether a joint turns all other joints: then a base tilt about its axis is equivalent to its offset."""
    return bool(robot.carries[joint].all()) and not robot.slides[joint]


def spins(robot: Robot, joint: int) -> bool:
    """Whether what a joint moves only spins about a vertical axis: its weight loads no joint, so it acts like a rotor."""
    if robot.slides[joint] or robot.carries[:, joint].sum() > 1:
        return False
    model, order = robot.pinocchio_model()
    jacobian = pin.computeJointJacobians(model, model.createData(), pin.neutral(model))
    pull = np.cross(jacobian[3:, int(order[joint])], robot.gravity_vector)
    return bool(np.linalg.norm(pull) <= UPRIGHT * np.linalg.norm(robot.gravity_vector))
