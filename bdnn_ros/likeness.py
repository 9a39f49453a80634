"""Whether a model belongs to the arm of a description: the same joints in the same places.

Masses and friction may differ: that is what models learn and corrected descriptions correct.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from bdnn_ros.bdnn.dynamics import BDNN
from bdnn_ros.dynamics import Dynamics
from bdnn_ros.errors import ModelFileError
from bdnn_ros.robot import Robot

ALIKE = 0.02
"""Joints of one arm sit alike up to so much of the longest distance between two, turned by as much [rad]: descriptions
of one arm differ by its calibration, those of two arms of a series by more."""


@dataclass(frozen=True)
class Seat:
    """Where a joint is mounted, with all joints at zero.

    Attributes:
        parent: the joint that carries it; "universe" for the base.
        place: of its frame in the parent's, (3,) [m]; zero on the base, wherever in a cell that is.
        rotation: of its frame in the parent's, (3, 3).
        axis: motion at unit velocity in its own frame, linear over angular, (6,).
    """

    parent: str
    place: np.ndarray
    rotation: np.ndarray
    axis: np.ndarray

    def like(self, other: Seat, reach: float) -> bool:
        """Whether another is the same up to calibration, on an arm with this reach [m]."""
        turned = np.linalg.norm(self.rotation - other.rotation) / np.sqrt(2.0)
        moved = np.linalg.norm(self.place - other.place)
        askew = np.linalg.norm(self.axis - other.axis)
        return bool(
            self.parent == other.parent and max(turned, askew) <= ALIKE and moved <= ALIKE * reach + 1e-6
        )


def require_arm(model: Dynamics, robot: Robot, name: str) -> None:
    """Refuse a model of another arm with the same joint names; for networks alone this cannot be told.

    Args:
        robot: the description, with the model's joints in any order.
        name: the model's, for the message.

    Raises:
        ModelFileError: it is of another.
    """
    own = description_of(model)
    if own is None or own.urdf == robot.urdf:
        return
    # what both leave out stands alike: where it stood does not make another arm of it
    theirs, ours = _seats(own.urdf, robot.joints), _seats(robot.urdf, robot.joints)
    reach = max(float(np.linalg.norm(seat.place)) for seat in ours)
    for joint, seat, other in zip(robot.joints, ours, theirs, strict=True):
        if not seat.like(other, reach):
            raise ModelFileError(
                f"{name} is a model of another arm: its {joint} sits or turns otherwise than the robot description's.",
                "Load a model of this robot.",
            )


def description_of(model: object) -> Robot | None:
    """The robot that a model or its prior contains; None without one, or if it was learned from motion alone.

    The links and axes of a robot learned from motion need not be where the arm's are.
    """
    if type(model) is BDNN:
        return None
    for held in (model, getattr(model, "robot", None)):
        if isinstance(held, Robot):
            return held
    prior = getattr(getattr(model, "core", None), "prior", None)
    return None if prior is None else description_of(prior)


def _seats(urdf: str, joints: Sequence[str]) -> list[Seat]:
    """The seats of these joints of a URDF, without any joint zeros that were learned."""
    model, order = Robot.from_urdf(urdf, joints).pinocchio_model()
    data = model.createData()
    pin.computeJointJacobians(model, data, np.zeros(model.nq))
    seats = []
    for number in order.tolist():
        frame = model.jointPlacements[number + 1]
        axis = pin.getJointJacobian(model, data, number + 1, pin.ReferenceFrame.LOCAL)[:, number]
        parent = int(model.parents[number + 1])
        place = frame.translation if parent else np.zeros(3)
        seats.append(Seat(model.names[parent], place.copy(), frame.rotation.copy(), axis.copy()))
    return seats
