"""Doubts about a robot description, whatever was recorded: its errors would be taken for causes elsewhere."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from bdnn_ros.errors import RobotError, UsageError, listed
from bdnn_ros.physical.remark import Remark
from bdnn_ros.robot import Robot
from bdnn_ros.robot.urdf import inertia_of, link_inertia

ROUNDING = 1.05
"""Rounded moments of inertia may exceed the sum of the other two by this factor."""
POINT = 1e-6
"""And by so much for each kilogram: then all of them are next to nothing [m²]."""
SPREAD = 1.25
"""No mass is spread over more than this many times the longest link: half of it at each end of two of them makes 1."""
LEAST_SPREAD = 0.5
"""And spreads below this are never doubted: a turntable has no length [m]."""
MATTERS = 0.05
"""Share of its body's largest moment of inertia that makes a link's worth a word."""
LONG = 0.05
"""Links of this length have mass; shorter ones may be frames between two joints at one place [m]."""


NO_MASS = (
    "The robot description gives none of the moving links a mass: it says nothing of gravity and inertia."
)
GIVE_MASS = "Give its links an <inertial>."


class Described(NamedTuple):
    """A moving link with an inertia.

    Attributes:
        joint: index of the joint that moves it.
        moments: principal moments of inertia about its centre of mass, ascending, (3,) [kg·m²].
        placeholder: whether its inertia is the identity matrix, which no real body happens to have.
        body: the largest principal moment of the body that it belongs to [kg·m²].
    """

    name: str
    joint: int
    mass: float
    moments: np.ndarray
    placeholder: bool
    body: float

    @property
    def ghost(self) -> bool:
        """Whether it has inertia worth mentioning but no mass; the simulation counts the inertia."""
        return self.mass == 0.0 and self.moments[2] > MATTERS * self.body

    @property
    def excess(self) -> float:
        """By how much the largest moment exceeds the sum of the others [kg·m²]."""
        return float(self.moments[2] - self.moments[0] - self.moments[1])

    @property
    def radius(self) -> float:
        """The largest radius of gyration [m]."""
        return float(np.sqrt(max(self.moments[2], 0.0) / self.mass))


def doubts(robot: Robot) -> Iterator[Remark]:
    """Links whose described mass or inertia is impossible or implausible for this robot."""
    if not robot.inertials[:, 0].any():
        yield Remark("", NO_MASS, GIVE_MASS)
        return
    lengths, described = _lengths(robot), _described(robot)
    yield from _massless(robot, lengths)
    yield from _ghosts(robot, [one for one in described if one.ghost])
    yield from _impossible([one for one in described if one.mass > 0.0], float(lengths.max()))


def require_mass(robot: Robot, remedy: str = GIVE_MASS) -> None:
    """Refuse a robot without any mass: no recording can be compared with it.

    Raises:
        RobotError: none has.
    """
    if not robot.inertials[:, 0].any():
        raise RobotError(NO_MASS, remedy)


def _massless(robot: Robot, lengths: np.ndarray) -> Iterator[Remark]:
    bare = (robot.inertials[:, 0] == 0.0) & (lengths > LONG)
    if bare.any():
        links = [robot.moving_link(joint) for joint, one in zip(robot.joints, bare, strict=True) if one]
        yield Remark(
            listed(links),
            f"The robot description gives {listed(links)} no mass.",
            "Give it an <inertial>: what it weighs will pass for something else.",
        )


def _ghosts(robot: Robot, links: Sequence[Described]) -> Iterator[Remark]:
    if not links:
        return
    names = listed(one.name for one in links)
    moved = listed(dict.fromkeys(robot.moving_link(robot.joints[one.joint]) for one in links))
    yield Remark(
        names,
        f"The robot description gives {names} no mass but an inertia ({links[0].name}: {links[0].moments[2]:.3g} kg·m²), "
        f"which counts as one of {moved}: no body without mass has any.",
        "Remove the inertia, or give it a mass: what it gets wrong will pass for causes, there or elsewhere.",
    )


def weightless(robot: Robot, link: str) -> list[str]:
    """Links without mass whose described inertia belongs to the same body as `link`."""
    body, _, _ = robot.body_of(link)
    return [one.name for one in _described(robot) if one.ghost and one.joint == body]


def _impossible(links: list[Described], longest: float) -> Iterator[Remark]:
    remedy = "Correct its <inertial>: what it gets wrong will pass for causes, there or elsewhere."
    placeholders = [one for one in links if one.placeholder and one.moments[2] > MATTERS * one.body]
    if placeholders:
        names = listed(one.name for one in placeholders)
        yield Remark(
            names, f"The described inertia of {names} is the identity matrix: a placeholder.", remedy
        )
    flat = [
        one
        for one in links
        if one.excess > max((ROUNDING - 1.0) * one.moments[:2].sum(), POINT * one.mass, MATTERS * one.body)
    ]
    if flat:
        names, first = listed(one.name for one in flat), flat[0]
        values = ", ".join(f"{value:.3g}" for value in first.moments)
        yield Remark(
            names,
            f"No body can have the described inertia of {names}: of its principal moments ({first.name}: {values} "
            "kg·m²) one is larger than the other two together.",
            remedy,
        )
    wide = [
        one
        for one in links
        if not one.placeholder
        and one.radius > max(SPREAD * longest, LEAST_SPREAD)
        and one.moments[2] > MATTERS * one.body
    ]
    if wide:
        names, first = listed(one.name for one in wide), max(wide, key=lambda one: one.radius)
        yield Remark(
            names,
            f"The described inertia of {names} is too large for its mass: {first.moments[2]:.3g} kg·m² of "
            f"{first.mass:.3g} kg ({first.name}) is a mass {first.radius:.2g} m away from its centre, and no link is "
            f"longer than {longest:.2g} m.",
            remedy,
        )


def _described(robot: Robot) -> list[Described]:
    """Links with mass or inertia on the moving bodies."""
    largest = [_moments(inertia_of(values))[2] for values in robot.inertials]
    found = []
    for link in robot.links:
        try:
            body, _, _ = robot.body_of(link)
        except UsageError:
            continue  # it does not move
        own = link_inertia(robot.urdf, link)
        if own.mass > 0.0 or own.inertia.any():
            identity = bool(np.array_equal(own.inertia, np.eye(3)))
            found.append(Described(link, body, own.mass, _moments(own), identity, largest[body]))
    return found


def _moments(inertia: pin.Inertia) -> np.ndarray:
    return np.linalg.eigvalsh(inertia.inertia)


def _lengths(robot: Robot) -> np.ndarray:
    """Distance from each joint to the farthest of its body's centre of mass, next joint or other frame, (n,) [m]."""
    model, order = robot.pinocchio_model()
    far = np.array([np.linalg.norm(inertia.lever) for inertia in model.inertias])
    for parent, placement in zip(model.parents, model.jointPlacements, strict=True):
        far[parent] = max(far[parent], np.linalg.norm(placement.translation))
    for frame in model.frames:
        far[frame.parentJoint] = max(far[frame.parentJoint], np.linalg.norm(frame.placement.translation))
    by_velocity = {model.idx_vs[index]: far[index] for index in range(1, model.njoints)}
    return np.array([by_velocity[index] for index in order])
