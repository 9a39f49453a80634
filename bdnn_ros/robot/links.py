"""What a robot's description says of its individual links."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin

from bdnn_ros.errors import UsageError
from bdnn_ros.robot import Robot
from bdnn_ros.robot.urdf import link_inertia

LIGHTEST = 0.05
"""Least mass of a link, as a share of the described one."""


def described_inertial(robot: Robot, link: str) -> tuple[int, np.ndarray]:
    """What one link adds to its body: (joint index, inertial parameters in the body's frame (PER_LINK,)).

    Links fixed to it are not counted, but where a joint moves a bare frame that bears all its mass on them; zero where the
    description gives none of them any.

    Raises:
        UsageError: there is no such link, or it does not move.
    """
    body, rotation, translation = robot.body_of(link)
    own = link_inertia(robot.urdf, link)
    if own.mass == 0.0 and link == robot.moving_link(robot.joints[body]):
        return body, _bodies(robot.urdf, robot.joints, robot.held)[body].copy()
    return body, np.array(pin.SE3(rotation, translation).act(own).toDynamicParameters())


def link_inertial(robot: Robot, link: str) -> tuple[int, np.ndarray]:
    """`described_inertial` of a link that has mass.

    Raises:
        UsageError: there is no such link, it does not move, or the URDF gives it no mass.
    """
    body, described = described_inertial(robot, link)
    if described[0] <= 0.0:
        raise UsageError(f"Link {link!r} has no mass in the URDF.", "Name a link with an <inertial>.")
    return body, described


def link_mass(robot: Robot, link: str, carried: float = 0.0) -> float:
    """What a link weighs whose body may be another than described [kg]: all that this weighs more but a load is the link's.

    Args:
        carried: what is known to hang from it [kg].

    Raises:
        UsageError: as `link_inertial`.
    """
    body, described = link_inertial(robot, link)
    more = robot.inertials[body, 0] - _bodies(robot.urdf, robot.joints, robot.held)[body, 0]
    return float(max(described[0] + more - carried, LIGHTEST * described[0]))


def described_mass(robot: Robot) -> float:
    """Mass of all moving bodies by the description, whatever the robot's own may have become [kg]."""
    return float(_bodies(robot.urdf, robot.joints, robot.held)[:, 0].sum())


def needed_link(link: str | None) -> str:
    """The link an effect was given.

    Raises:
        UsageError: none was.
    """
    if link is None:
        raise UsageError("This effect acts on a link, and none is named.", "Name it: effect@link.")
    return link


@lru_cache(maxsize=8)
def _bodies(urdf: str, joints: tuple[str, ...], held: tuple[tuple[str, float], ...]) -> np.ndarray:
    """Inertial parameters of the bodies as described, (n, PER_LINK); the robot's own may have changed."""
    return Robot.from_urdf(urdf, joints, dict(held)).inertials
