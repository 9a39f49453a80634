"""Physical parameters of a robot, and their prior before any motion: the URDF with a spread."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.robot.bodies import feasible_pseudo_inertia, heaviness, inertial_parameters, pseudo_inertia

INERTIAL_NAMES = ("mass", "mass_x", "mass_y", "mass_z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""m [kg], m·c [kg·m], inertia about the link frame's origin [kg·m²], in the order of `Robot.inertials`."""
JOINT_NAMES = ("armature", "viscous", "coulomb", "offset")
"""[kg·m²], [N·m·s/rad], [N·m], [N·m] of each joint."""
PER_JOINT = len(JOINT_NAMES)
WIDEST_SPREAD = 10.0
"""Beyond, a spread says nothing any more."""


@dataclass(frozen=True)
class Spread:
    """How far the real robot is expected to be from its URDF (prior standard deviations).

    Attributes:
        inertial: relative standard deviation of every link's mass, centre and inertia; the prior is the same
            whatever frame the link is described in.
        load: standard deviation of the mass of something unknown that may be fixed to any link, as a share of the mean
            link mass.
        armature: standard deviation of the rotor inertia, in units of the joint's mean diagonal entry of M.
        friction: standard deviation of Coulomb friction, in units of the joint's effort scale; of viscous
            friction, the same at the joint's velocity limit.
        offset: standard deviation of the effort offset, in the same unit.
    """

    inertial: float = 0.3
    load: float = 0.03
    armature: float = 1.0
    friction: float = 1.0
    offset: float = 0.1


@dataclass(frozen=True)
class Prior:
    """A Gaussian over the P = n·(PER_LINK + PER_JOINT) parameters: inertials link by link, then each of
    `JOINT_NAMES`.

    Attributes:
        mean: (P,).
        covariance: (P, P).
        effort_scale: typical effort of each joint, (n,) [N·m].
    """

    mean: np.ndarray
    covariance: np.ndarray
    effort_scale: np.ndarray


@dataclass(frozen=True)
class Parameters:
    """Parameters of a robot by kind.

    Attributes:
        inertials: (n, PER_LINK), as `Robot.inertials`.
        armature, viscous, coulomb, offset: (n,) each, as `JOINT_NAMES`.
    """

    inertials: np.ndarray
    armature: np.ndarray
    viscous: np.ndarray
    coulomb: np.ndarray
    offset: np.ndarray

    @classmethod
    def from_vector(cls, vector: np.ndarray) -> Parameters:
        """Parameters from the vector of `Prior.mean`'s order, (P,)."""
        width = len(vector) // (PER_LINK + PER_JOINT)
        inertials, joints = vector[: width * PER_LINK], vector[width * PER_LINK :]
        return cls(inertials.reshape(width, PER_LINK).copy(), *joints.reshape(PER_JOINT, width).copy())

    def vector(self) -> np.ndarray:
        """All parameters in one vector, (P,)."""
        return np.concatenate(
            [self.inertials.ravel(), self.armature, self.viscous, self.coulomb, self.offset]
        )


def parameter_names(joints: Sequence[str]) -> list[str]:
    """Names of the P parameters, `joint.parameter`; a link goes by the joint that moves it."""
    inertial = [f"{joint}.{name}" for joint in joints for name in INERTIAL_NAMES]
    return inertial + [f"{joint}.{name}" for name in JOINT_NAMES for joint in joints]


def of_robot(robot: Robot) -> Parameters:
    """The present parameters of a robot, with zero offset."""
    return Parameters(robot.inertials, robot.armature, robot.viscous, robot.coulomb, np.zeros(robot.width))


def prior(robot: Robot, spread: Spread | None = None) -> Prior:
    """The prior belief that the real robot is close to this one.

    The real pseudo-inertia of a link with J = L Lᵀ is L exp(X) Lᵀ, with X a symmetric Gaussian of standard deviation
    `spread.inertial`: to first order the affine-invariant metric of Lee, Wensing and Park, "Geometric robot dynamic
    identification" (IEEE T-RO 2020), which does not depend on frame or unit.
    """
    spread = spread or Spread()
    width = robot.width
    size = width * (PER_LINK + PER_JOINT)
    covariance = np.zeros((size, size))
    something, heavy = _unknown_body(robot, spread.load), heaviness(robot.inertials)
    for body, values in enumerate(robot.inertials):
        rows = slice(body * PER_LINK, (body + 1) * PER_LINK)
        link = feasible_pseudo_inertia(pseudo_inertia(values), heavy)
        for pseudo, deviation in ((link, spread.inertial), (something, 1.0)):
            tangent = tangent_basis(np.linalg.cholesky(pseudo))
            covariance[rows, rows] += deviation**2 * tangent @ tangent.T
    effort, inertia, velocity = _scales(robot)
    deviations = np.concatenate(
        [
            spread.armature * inertia,
            spread.friction * effort / velocity,
            spread.friction * effort,
            spread.offset * effort,
        ]
    )
    covariance[width * PER_LINK :, width * PER_LINK :] = np.diag(deviations**2)
    return Prior(of_robot(robot).vector(), covariance, effort)


def tangent_basis(factor: np.ndarray) -> np.ndarray:
    """Inertial parameters of L X Lᵀ, one column for each of ten orthonormal symmetric X, (PER_LINK, 10)."""
    steps, linear = _symmetric_steps()
    return np.asarray(linear @ (factor @ steps @ factor.T).reshape(len(steps), -1).T)


@cache
def _symmetric_steps() -> tuple[np.ndarray, np.ndarray]:
    """Ten orthonormal symmetric matrices (10, 4, 4), and `inertial_parameters` as a matrix, (PER_LINK, 16)."""
    steps = []
    for row in range(4):
        for column in range(row + 1):
            step = np.zeros((4, 4))
            step[row, column] = step[column, row] = 1.0 if row == column else np.sqrt(0.5)
            steps.append(step)
    linear = [inertial_parameters(unit.reshape(4, 4)) for unit in np.eye(16)]
    return np.array(steps), np.array(linear).T


def _unknown_body(robot: Robot, share: float) -> np.ndarray:
    """Pseudo-inertia of a body of unknown shape at a link's origin, a decimetre across, (4, 4)."""
    mass = max(share * float(np.mean(robot.inertials[:, 0])), 3e-4 * heaviness(robot.inertials))
    return mass * np.diag([0.1**2, 0.1**2, 0.1**2, 1.0])


def usual_motion(robot: Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random positions, velocities and accelerations in the usual range of the joints, (N, n) each."""
    generator = np.random.default_rng(0)
    count = 200
    low, high = robot.limits.usual_range
    position = generator.uniform(low, np.maximum(high, low + 1e-6), (count, robot.width))
    limit = robot.limits.usual_velocity
    acceleration = generator.normal(size=(count, robot.width)) * 2.0 * limit
    return position, generator.uniform(-1.0, 1.0, (count, robot.width)) * limit, acceleration


def _scales(robot: Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Typical effort [N·m], diagonal of M [kg·m²] and velocity [rad/s] of each joint by URDF, (n,)."""
    position, motion, acceleration = usual_motion(robot)
    velocity = robot.limits.usual_velocity
    inertia = np.diagonal(robot.mass_matrix(position), axis1=1, axis2=2).mean(axis=0)
    effort = np.sqrt(np.mean(robot.rigid_effort(position, motion, acceleration) ** 2, axis=0))
    heavy = heaviness(robot.inertials)
    # what a drive adds hardly shrinks with the link it moves: a wrist's gear may outweigh the whole hand
    effort, inertia = effort + 0.05 * effort.max(), inertia + 0.2 * inertia.max()
    return effort + 1e-3 * heavy, inertia + 1e-6 * heavy, velocity
