"""Base parameters: the combinations of inertial parameters that motion can identify, each with a description in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from bdnn_ros.physical.parameters import INERTIAL_NAMES, JOINT_NAMES, PER_JOINT
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.robot.units import along

MOTIONS = 60
"""Random motions that stand for all there are."""
DEPENDENT = 1e-4
"""A column whose rest is shorter than this, relative to its length, depends on those before it.

A right angle that is written as 1.5708 leaves 5e-6, and what a motion shows at all 5e-3 or more.
"""
SMALLEST_TERM = 1e-6
"""Terms smaller than this are rounding."""
UNTOLD = 1e-4
"""And smaller than this, they are not told: a right angle that is written short makes them."""
TERMS = 4
"""Terms a name spells out."""
WORDS = {
    "mass": ("mass", "kg"),
    "mass_x": ("mass times centre along x", "kg*m"),
    "mass_y": ("mass times centre along y", "kg*m"),
    "mass_z": ("mass times centre along z", "kg*m"),
    "Ixx": ("inertia about x", "kg*m^2"),
    "Ixy": ("product of inertia xy", "kg*m^2"),
    "Iyy": ("inertia about y", "kg*m^2"),
    "Ixz": ("product of inertia xz", "kg*m^2"),
    "Iyz": ("product of inertia yz", "kg*m^2"),
    "Izz": ("inertia about z", "kg*m^2"),
    "armature": ("rotor inertia", "kg*m^2"),
    "viscous": ("viscous friction", "N*m*s/rad"),
    "coulomb": ("Coulomb friction", "N*m"),
    "offset": ("effort offset", "N*m"),
}
"""Each parameter in words, and its unit; inertias are about the link frame's origin."""


@dataclass(frozen=True)
class Combination:
    """A combination of parameters that motion can identify separately from all others.

    Attributes:
        words: what it is, "mass times centre along x of link3, with 0.32 of mass of link4 and ...".
        unit: of its value.
        weights: of the parameters in the order of `parameter_names`, (P,).
    """

    words: str
    unit: str
    weights: np.ndarray

    def value(self, parameters: np.ndarray) -> float:
        """Its value for parameters (P,)."""
        return float(self.weights @ parameters)

    def std(self, covariance: np.ndarray) -> float:
        """Its standard deviation for the parameters' covariance (P, P)."""
        return float(np.sqrt(max(self.weights @ covariance @ self.weights, 0.0)))


def combinations(robot: Robot) -> list[Combination]:
    """The identifiable combinations of a robot: base parameters, then friction and offset of each joint.

    A parameter whose effort is a linear combination of others' is merged into them (Gautier and Khalil, IEEE T-RA 1990). The
    dependencies are found by orthogonalising the columns of random motions, rotor inertias included.
    """
    width = robot.width
    first, armature = _order(robot)
    columns = _columns(robot)[:, first]
    kept, mixing = _independent(columns)
    names = [f"{link}.{name}" for link in _links(robot) for name in INERTIAL_NAMES]
    names += [f"{joint}.armature" for joint in robot.joints]
    size = width * (PER_LINK + PER_JOINT)
    result = []
    for row, index in enumerate(kept):
        weights = np.zeros(size)
        weights[first] = mixing[row]
        name = names[first[index]]
        result.append(Combination(_in_words(names, first[index], weights), unit_of(name, robot), weights))
    for kind, name in enumerate(JOINT_NAMES[1:], start=1):
        for k, joint in enumerate(robot.joints):
            weights = np.zeros(size)
            weights[armature + kind * width + k] = 1.0
            unit = unit_of(f"{joint}.{name}", robot)
            result.append(Combination(f"{WORDS[name][0]} of {joint}", unit, weights))
    return result


def unit_of(name: str, robot: Robot) -> str:
    """Unit of a parameter such as `link3.mass` or `joint3.viscous`."""
    place, parameter = name.rsplit(".", 1)
    return along(WORDS[parameter][1], parameter in JOINT_NAMES and robot.slides[robot.joints.index(place)])


def _order(robot: Robot) -> tuple[np.ndarray, int]:
    """Parameters in the order of preference (rotors, then links from the base), and the index at which rotors start."""
    armature = robot.width * PER_LINK
    return np.concatenate([armature + np.arange(robot.width), np.arange(armature)]), armature


def _columns(robot: Robot) -> np.ndarray:
    """Effort of random motions per inertial parameter and rotor inertia, (MOTIONS · n, n · PER_LINK + n)."""
    generator = np.random.default_rng(0)
    q, v, a = generator.uniform(-np.pi, np.pi, (3, MOTIONS * robot.width, robot.width))
    rotors = np.einsum("tj,jk->tjk", a, np.eye(robot.width))
    columns = np.concatenate([robot.regressor(q, v, a), rotors], axis=-1)
    return np.asarray(columns.reshape(-1, columns.shape[-1]))


def _independent(columns: np.ndarray) -> tuple[list[int], np.ndarray]:
    """Columns that are independent of those before them, and the share of every column that each absorbs, (kept, all)."""
    triangle = qr(columns, mode="r")[0][: columns.shape[1]]
    length = np.linalg.norm(columns, axis=0)
    kept: list[int] = []
    basis = np.zeros((len(triangle), 0))
    for index, column in enumerate(triangle.T):
        rest = column - basis @ (basis.T @ column)
        rest = rest - basis @ (basis.T @ rest)
        if np.linalg.norm(rest) > DEPENDENT * max(length[index], 1e-12) and length[index] > 1e-9:
            kept.append(index)
            basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
    mixing = np.linalg.lstsq(triangle[:, kept], triangle, rcond=None)[0]
    return kept, np.where(np.abs(mixing) > SMALLEST_TERM, mixing, 0.0)


def _links(robot: Robot) -> list[str]:
    return [robot.moving_link(joint) for joint in robot.joints]


def _in_words(names: list[str], leading: int, weights: np.ndarray) -> str:
    """A combination in words: its leading parameter, then the largest others."""
    others = [k for k in np.argsort(-np.abs(weights)) if abs(weights[k]) > UNTOLD and k != leading]
    text = _of(names[leading])
    if others:
        terms = [_term(weights[k], _of(names[k])) for k in others[:TERMS]]
        left = len(others) - len(terms)
        text += ", with " + ", ".join(terms) + (f" and {left} more" if left > 0 else "")
    return text


def _of(name: str) -> str:
    place, parameter = name.rsplit(".", 1)
    return f"{WORDS[parameter][0]} of {place}"


def _term(weight: float, words: str) -> str:
    return words if abs(weight - 1.0) < 1e-9 else f"{weight:.3g} × {words}"
