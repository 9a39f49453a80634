"""How a robot is set up: the direction of gravity, and the zeros of its joints."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin

STANDARD_GRAVITY = (0.0, 0.0, -9.81)
"""Acceleration of gravity on a level base, in its axes [m/s²]."""


def gravity_of(roll: float, pitch: float) -> np.ndarray:
    """Acceleration of gravity (3,) [m/s²] that a base turned by Ry(pitch)·Rx(roll) from level [rad] sees."""
    turned = pin.utils.rotate("y", pitch) @ pin.utils.rotate("x", roll)
    return np.asarray(turned.T @ np.array(STANDARD_GRAVITY))


def tilt_of(gravity_vector: np.ndarray) -> tuple[float, float]:
    """Roll and pitch [rad] of a base turned by Ry(pitch)·Rx(roll) that sees this gravity, (3,)."""
    x, y, z = -np.asarray(gravity_vector) / np.linalg.norm(gravity_vector)
    return math.atan2(y, z) + 0.0, -math.asin(max(-1.0, min(1.0, x))) + 0.0


def zeros_of(joints: Sequence[str], zeros: Mapping[str, float]) -> np.ndarray:
    """Joints' zeros by name, (n,) [rad] ([m]); 0 where none is given."""
    return np.array([zeros.get(joint, 0.0) for joint in joints])


def turned_back(model: pin.Model, joint: int, zero: float) -> pin.SE3:
    """Placement of a one-degree-of-freedom joint that compensates a reported position that exceeds the true one by `zero`
    [rad] ([m]).
    """
    data, positions = model.joints[joint].createData(), np.zeros(model.nq)
    positions[model.idx_qs[joint]] = -zero
    model.joints[joint].calc(data, positions)
    return model.jointPlacements[joint] * data.M
